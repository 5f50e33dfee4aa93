"""Tracklets and factors of your own in one fixed-lag smoother.

Stereo measurements come one by one, each at its own time, and an odometer measures the velocity
every 50 ms. For half a second nothing is seen, and the odometer holds the motion; then landmarks of
before are seen again. Run as ``python -m examples.fixed_lag_smoother``; with a file name it also
saves a plot.
"""

from __future__ import annotations

import sys
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V
from numpy.typing import NDArray

from factors import StereoCamera, extrapolate
from factors.lie import se3_inverse, se3_log
from gpvo import FixedLagSmoother, Measurements
from gpvo.config import NoiseConfig

Array = NDArray[np.float64]

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
TWIST = np.array([0.1, 0.2, 0.1, 0.2, 0.1, 0.3])  # the true motion, rad/s and m/s
NOISE = NoiseConfig(measurement_information=(10.0, 10.0, 10.0))  # 0.3 pixels
ODOMETER = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.01, 0.01, 0.02, 0.02, 0.02]))
PERIOD, CLUSTERS = 0.05, 30
DARK = range(15, 25)  # clusters in which nothing is seen
LANDMARKS = 20


def measure(cluster: int, points: Array, rng: np.random.Generator) -> Measurements:
    """Each point at a random time of the cluster: (u_left, v, disparity), pixels."""
    t = np.sort((cluster + rng.random(len(points))) * PERIOD).round(6)
    T_cam_world = se3_inverse(extrapolate(np.eye(4), TWIST, t).pose)
    in_camera = np.einsum("nij,nj->ni", T_cam_world[:, :3, :3], points) + T_cam_world[:, :3, 3]
    deviation = 1 / np.sqrt(np.array(NOISE.measurement_information))
    stereo = CAMERA.project(in_camera) + deviation * rng.normal(size=(len(points), 3))
    return Measurements(np.arange(len(points)), np.full(len(points), cluster), t, stereo)


def run(odometer: bool) -> Array:
    """Errors (n, 6) of the newest pose after each cluster, against the true motion."""
    rng, smoother, errors = np.random.default_rng(0), FixedLagSmoother(CAMERA, NOISE), []
    low, high = [-1.0, -1.0, 2.0], [1.0, 1.0, 5.0]
    points, nothing = rng.uniform(low, high, (LANDMARKS, 3)), Measurements.concatenate([])
    for cluster in range(CLUSTERS):
        end_time = (cluster + 1) * PERIOD
        measured = measure(cluster, points, rng)
        smoother.update(end_time, nothing if cluster in DARK else measured)
        states = smoother.states
        if odometer:
            newest = V(smoother.window[-1])  # the twist of the state at the cluster's end
            twist = TWIST + rng.normal(size=6) * ODOMETER.sigmas()
            smoother.add(gtsam.PriorFactorVector(newest, twist, ODOMETER))  # from the next update
        if cluster == 0:
            start = states.t[0]  # the world is the first pose
        from_start = extrapolate(np.eye(4), TWIST, np.array([end_time - start])).pose
        errors.append(se3_log(se3_inverse(states.T_world_cam[-1:]) @ from_start)[0])
    return np.array(errors)


def main(plot: Path | None = None) -> Array:
    """Print the largest errors without and with the odometer, and return the latter."""
    alone, helped = run(odometer=False), run(odometer=True)
    for name, errors in (("tracklets alone", alone), ("with an odometer", helped)):
        largest = np.linalg.norm(errors[:, 3:], axis=1).max()
        print(f"{name}: {len(errors)} states, largest position error {1e3 * largest:.1f} mm")
    if plot:
        save_plot(plot, alone, helped)
    return helped


def save_plot(path: Path, alone: Array, helped: Array) -> None:
    """Position errors after each cluster, and when nothing is seen."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(DARK[0] - 0.5, DARK[-1] + 0.5, color="0.93", label="nothing seen")
    for name, errors in (("tracklets alone", alone), ("with an odometer", helped)):
        axes.semilogy(1e3 * np.linalg.norm(errors[:, 3:], axis=1) + 1e-2, "o-", label=name)
    axes.set(xlabel="cluster", ylabel="position error (mm)")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
