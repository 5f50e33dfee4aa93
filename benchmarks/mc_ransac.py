"""Speed of MC-RANSAC against plain numpy, and its inliers against RANSAC with common times.

Run as `python -m benchmarks.mc_ransac`. Times are processor times of one thread, the shortest of
several runs.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from factors.lie import se3_exp
from factors.stereo import StereoCamera
from gpvo.config import McRansacConfig
from gpvo.mc_ransac import Segments, fast_mc_ransac, mc_ransac
from gpvo.mc_ransac.fast import random_samples
from gpvo.mc_ransac.segments import inlier_tolerance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CAMERA = StereoCamera(226.0, 226.0, 173.0, 130.0, 0.10)
INFORMATION = np.eye(3) / 0.3**2
PAPER = McRansacConfig(confidence=1, refinements=1)
SEEDS = 20


@dataclass(frozen=True)
class Case:
    """Tracklet segments of one cluster.

    Attributes
    ----------
    noise
        Standard deviation of every coordinate of a measurement, pixels.
    outliers
        Fraction of segments whose later end is moved by up to 40 pixels in u and v.
    turn
        Angular speed, rad/s; the linear speed is 0.5 m/s.
    spread
        Largest deviation of the segments' durations, as a fraction of the 0.1 s between clusters.
    """

    noise: float = 0.3
    outliers: float = 0.3
    turn: float = 1.0
    spread: float = 0.3

    def segments(self, count: int, seed: int) -> tuple[Segments, Mask]:
        """Draw random segments, and return which are inliers."""
        rng = np.random.default_rng(seed)
        points = rng.uniform([-1.5, -1, 1.5], [1.5, 1, 5], (count, 3))
        dt = 0.1 * (1 + self.spread * rng.uniform(-1, 1, count))
        twist = np.concatenate([_direction(rng) * self.turn, _direction(rng) * 0.5])
        T = se3_exp(-dt[:, None] * twist)
        moved = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
        earlier, later = CAMERA.project(points), CAMERA.project(moved)
        good = rng.permutation(count) >= round(self.outliers * count)
        later[~good, :2] += rng.uniform(-40, 40, ((~good).sum(), 2))
        shape = (count, 3)
        noisy = [end + self.noise * rng.normal(size=shape) for end in (earlier, later)]
        return Segments(noisy[0], noisy[1], dt), good


def _direction(rng: np.random.Generator) -> Array:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def numpy_fast_mc_ransac(
    segments: Segments, camera: StereoCamera, config: McRansacConfig, rng: np.random.Generator
) -> Array:
    """Compute the fast version's velocity (6,) in plain numpy, one sample after the other."""
    points = camera.triangulate(segments.earlier)
    displacements = camera.triangulate(segments.later) - points
    tolerance = inlier_tolerance(segments, config)
    samples = random_samples(len(segments), config.sample_size, config.iterations, rng)
    best, most = np.zeros(6), 0
    for sample in samples:
        x, y, z = points[sample].T
        zero, one = np.zeros(len(sample)), np.ones(len(sample))
        rows = [[zero, -z, y, -one, zero, zero]]
        rows += [[z, zero, -x, zero, -one, zero], [-y, x, zero, zero, zero, -one]]
        design = np.moveaxis(np.array(rows), 2, 0) * segments.dt[sample, None, None]
        flat = design.reshape(-1, 6)
        normal = flat.T @ flat
        if np.linalg.cond(normal) > 1e12:
            continue
        velocity = np.linalg.solve(normal, flat.T @ displacements[sample].ravel())
        T = se3_exp(-segments.dt[:, None] * velocity)
        moved = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
        error = np.linalg.norm(camera.project(moved) - segments.later, axis=1)
        count = int(((moved[:, 2] > 0) & (error <= tolerance)).sum())
        if count > most:
            best, most = velocity, count
    return best


def frame_based_inliers(
    segments: Segments, config: McRansacConfig, camera: StereoCamera = CAMERA
) -> Mask:
    """Find inliers of one transform between two common times by OpenCV's RANSAC, from 3D points."""
    points = camera.triangulate(segments.earlier)
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    cv2.setRNGSeed(0)
    found, _, _, inliers = cv2.solvePnPRansac(
        points,
        segments.later[:, :2].copy(),
        K,
        None,
        iterationsCount=1000,
        reprojectionError=config.pixel_threshold,
        confidence=config.confidence,
        flags=cv2.SOLVEPNP_EPNP,
    )
    mask = np.zeros(len(segments), bool)
    if found and inliers is not None:
        mask[inliers.ravel()] = True
    return mask


def continuous_inliers(segments: Segments, config: McRansacConfig) -> Mask:
    """Find the inliers of MC-RANSAC."""
    fit = mc_ransac(segments, CAMERA, INFORMATION, config, np.random.default_rng(0))
    return np.zeros(len(segments), bool) if fit is None else fit.inliers


def precision_and_recall(
    case: Case, method: Callable[[Segments, McRansacConfig], Mask], config: McRansacConfig
) -> tuple[float, float]:
    """Compute precision and recall, pooled over clusters of 120 tracklets."""
    right = accepted = good = 0
    for seed in range(SEEDS):
        segments, true = case.segments(120, seed)
        inliers = method(segments, config)
        right += int((inliers & true).sum())
        accepted, good = accepted + int(inliers.sum()), good + int(true.sum())
    return right / max(accepted, 1), right / good


def speed_table() -> Table:
    """Measure milliseconds for 300 tracklets."""
    table = Table("outliers", "10 000 samples", "adaptive", "adaptive, refined", "numpy, 10 000")
    for outliers in (0.0, 0.3, 0.5):
        segments, _ = Case(outliers=outliers).segments(300, 0)
        timed = [
            _milliseconds(partial(_fast, segments, PAPER)),
            _milliseconds(partial(_fast, segments, McRansacConfig())),
            _milliseconds(partial(continuous_inliers, segments, McRansacConfig())),
            _milliseconds(partial(_plain, segments), repetitions=2),
        ]
        table.add_row(f"{outliers:.0%}", *(f"{value:.1f} ms" for value in timed))
    return table


def _fast(segments: Segments, config: McRansacConfig) -> Array:
    return fast_mc_ransac(segments, CAMERA, config, np.random.default_rng(0))


def _plain(segments: Segments) -> Array:
    return numpy_fast_mc_ransac(segments, CAMERA, PAPER, np.random.default_rng(0))


def _milliseconds(call: Callable[[], object], repetitions: int = 7) -> float:
    call()
    spent = []
    for _ in range(repetitions):
        began = time.process_time()
        call()
        spent.append(time.process_time() - began)
    return 1e3 * min(spent)


def quality_table() -> Table:
    """Measure precision and recall while one condition at a time varies."""
    base, ours = Case(), McRansacConfig()
    table = Table("condition", "MC-RANSAC", "refined once", "paper's rule", "frame-based (OpenCV)")
    paper = replace_fields(ours, pixel_threshold=0, disparity_tolerance=0)
    cases = {"as it is": base}
    cases |= {f"noise {v} px": replace(base, noise=v) for v in (0.1, 0.6, 1.0)}
    cases |= {f"turning {v} rad/s": replace(base, turn=v) for v in (0.3, 3.0, 6.0)}
    cases |= {f"{v:.0%} outliers": replace(base, outliers=v) for v in (0.5, 0.7)}
    cases |= {f"durations differ by {v:.0%}": replace(base, spread=v) for v in (0.0, 0.6)}
    for name, case in cases.items():
        columns = [
            precision_and_recall(case, continuous_inliers, ours),
            precision_and_recall(case, continuous_inliers, replace_fields(ours, refinements=1)),
            precision_and_recall(case, continuous_inliers, paper),
            precision_and_recall(case, frame_based_inliers, ours),
        ]
        table.add_row(name, *(f"{p:.3f} / {r:.3f}" for p, r in columns))
    return table


def replace_fields(config: McRansacConfig, **fields: float) -> McRansacConfig:
    """Return the configuration with other values."""
    return config.model_copy(update=fields)


def main() -> None:
    """Print both tables."""
    cv2.setNumThreads(1)
    console = Console()
    console.print("Time for 300 tracklets", speed_table())
    console.print(f"Precision / recall over {SEEDS} clusters of 120 tracklets", quality_table())


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
