"""MC-RANSAC alone: one velocity from stereo measurements that share no time, half of them wrong.

Run as ``python -m examples.mc_ransac``; with a file name it also saves a plot.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera, extrapolate
from factors.lie import se3_inverse
from gpvo.config import McRansacConfig
from gpvo.mc_ransac import Segments, VelocityFit, mc_ransac

Array = NDArray[np.float64]

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
TWIST = np.array([0.2, 0.5, -0.1, 0.3, 0.1, 0.6])  # the true motion, rad/s and m/s
INFORMATION = (10.0, 10.0, 10.0)  # of (u_left, v, disparity), 1 / pixels^2


def measure(rng: np.random.Generator, count: int = 120) -> tuple[Segments, NDArray[np.bool_]]:
    """Each landmark at two times of its own; also which are right."""
    points = np.column_stack([rng.uniform(-2, 2, (count, 2)), rng.uniform(2, 6, count)])
    dt = rng.uniform(0.03, 0.15, count)
    T = se3_inverse(extrapolate(np.eye(4), TWIST, dt).pose)
    moved = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    earlier, later = CAMERA.project(points), CAMERA.project(moved)
    good = rng.random(count) < 0.5
    later[~good] += rng.uniform(5, 20, (count, 3))[~good] * [1, -1, 0.1]
    noise = 0.3 * rng.normal(size=(2, count, 3))
    return Segments(earlier + noise[0], later + noise[1], dt), good


def main(plot: Path | None = None) -> tuple[VelocityFit, NDArray[np.bool_]]:
    """Return what MC-RANSAC finds, and which segments are right."""
    segments, good = measure(np.random.default_rng(0))
    fit = mc_ransac(segments, CAMERA, INFORMATION, McRansacConfig(), rng=0)
    assert fit is not None
    deviations = np.sqrt(np.diag(fit.covariance))
    for name, found, true, sigma in zip(
        ("wx", "wy", "wz", "vx", "vy", "vz"), fit.velocity, TWIST, deviations, strict=True
    ):
        print(f"{name} = {found:+.3f} +- {sigma:.3f}, true {true:+.3f}")
    print(f"{fit.inliers.sum()} inliers of {len(segments)}, {good.sum()} are right")
    if plot:
        save_plot(plot, segments, fit)
    return fit, good


def save_plot(path: Path, segments: Segments, fit: VelocityFit) -> None:
    """Image motion of inliers and outliers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4.5), layout="constrained")
    axes, move = figure.subplots(), segments.later - segments.earlier
    for chosen, color, name in ((~fit.inliers, "C3", "outliers"), (fit.inliers, "C0", "inliers")):
        start, step = segments.earlier[chosen], move[chosen]
        axes.quiver(
            *start[:, :2].T,
            *step[:, :2].T,
            color=color,
            label=name,
            units="xy",
            scale=1,
            angles="xy",
        )
    axes.set(xlabel="u (pixels)", ylabel="v (pixels)", aspect="equal")
    axes.invert_yaxis()
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
