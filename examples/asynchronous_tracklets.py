"""Feed asynchronous tracklets into the smoother by hand, and query poses between its states.

    python examples/asynchronous_tracklets.py [plot.png]

Every measurement has its own time, and no two of them need to share one. After each cluster the
trajectory so far can be queried at any time, with its uncertainty.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse
from gpvo import FixedLagSmoother, Measurements, Trajectory
from gpvo.config import NoiseConfig

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
NOISE = NoiseConfig(measurement_information=(1.0, 1.0, 1.0))  # a pixel
PERIOD = 0.05  # seconds per cluster
CLUSTERS = 16
GAP = range(9, 13)  # clusters in which nothing is seen


def true_pose(t: np.ndarray) -> np.ndarray:
    """Return T_world_cam (N, 4, 4): an oscillation to the sides with a small rotation."""
    twist = np.zeros((len(t), 6))
    twist[:, 1] = 0.05 * np.sin(2 * t)  # rotation about y, rad
    twist[:, 3] = 0.1 * np.sin(2 * t)  # translation along x, m
    return se3_exp(twist)


def measure(frame: int, points: np.ndarray, rng: np.random.Generator) -> Measurements:
    """Measure each point as (u_left, v, disparity) at a random time of the cluster.

    The noise has a standard deviation of one pixel.
    """
    t = np.sort((frame + rng.random(len(points))) * PERIOD)
    T_cam_world = se3_inverse(true_pose(t))
    local = np.einsum("nij,nj->ni", T_cam_world[:, :3, :3], points) + T_cam_world[:, :3, 3]
    stereo = CAMERA.project(local) + rng.standard_normal((len(points), 3))
    return Measurements(np.arange(len(points)), np.full(len(points), frame), t, stereo)


def estimate() -> Trajectory:
    """Estimate the trajectory of all clusters and print the newest pose after each."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-1.0, -0.7, 1.5], [1.0, 0.7, 3.0], (30, 3))
    nothing = Measurements.concatenate([])
    smoother = FixedLagSmoother(CAMERA, NOISE)
    for frame in range(CLUSTERS):
        measurements = nothing if frame in GAP else measure(frame, points, rng)
        smoother.update((frame + 1) * PERIOD, measurements)
        trajectory = smoother.trajectory()
        assert trajectory is not None
        now = trajectory.stop - 0.0123  # any time is possible, also between states
        x = trajectory.pose(now)[0, 3]
        sigma = np.sqrt(trajectory.covariance(now)[3, 3])
        print(f"t = {now:.4f} s: x = {x:+.3f} m, 3 sigma {3 * sigma:.3f} m")
    assert trajectory is not None
    return trajectory


def plot(trajectory: Trajectory, path: Path) -> None:
    """Plot the error along x and its 3 sigma bounds."""
    from matplotlib.figure import Figure

    t = np.linspace(trajectory.start, trajectory.stop, 400)
    start = true_pose(np.array([trajectory.start]))
    error = se3_inverse(se3_inverse(start) @ true_pose(t)) @ trajectory.pose(t)
    bound = 3 * np.sqrt(trajectory.covariance(t)[:, 3, 3])
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(GAP[0] * PERIOD, (GAP[-1] + 1) * PERIOD, color="0.93", label="nothing seen")
    axes.fill_between(t, -1e3 * bound, 1e3 * bound, alpha=0.25, label="3 sigma")
    axes.plot(t, 1e3 * error[:, 0, 3], label="error along x")
    axes.set(xlabel="time (s)", ylabel="error (mm)", xlim=(t[0], t[-1]))
    axes.legend(loc="upper left", frameon=False, ncols=3)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    plot(estimate(), Path(sys.argv[1] if len(sys.argv) > 1 else "asynchronous_tracklets.png"))
