"""Lidar points, each at its own time: registration without a distorted scan.

A spinning lidar measures one point after another while it moves through a room. Each point is on a
wall at its own microsecond; the graph has a state every 50 ms only. Taken all at the start of their
scan instead, the points are off by the motion within it. Run as ``python -m
examples.lidar_points``; with a file name it also saves a plot.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import (
    GaussianProcess,
    InterpolatedFactor,
    PointToPlaneFactor,
    WnoaPriorFactor,
    extrapolate,
    optimize,
)
from factors.lie import se3_inverse, se3_log

Array = NDArray[np.float64]

TWIST = np.array([0.1, -0.2, 1.0, 0.5, 0.8, 0.1])  # the true motion, rad/s and m/s
QC = np.full(6, 1e-2)  # power spectral density of the acceleration
SCAN = 0.05  # seconds a turn, and between states
STATES = [(X(k), V(k), SCAN * k) for k in range(11)]  # pose key, velocity key, seconds
NOISE = gtsam.noiseModel.Isotropic.Sigma(1, 0.01)  # metres
MOUNTED = gtsam.Pose3(gtsam.Rot3.Ypr(0.1, 0.3, -0.2), np.array([0.1, 0.0, 0.3]))  # on the body
# A room: planes normal . x = distance.
WALLS = [(np.eye(3)[k // 2] * (1 - 2 * (k % 2)), 3.0 + k % 3) for k in range(6)]


def measure(rng: np.random.Generator, count: int) -> tuple[Array, Array, list[int]]:
    """Times (n,), points (n, 3) in the lidar's frame, and the number of the wall of each."""
    t = np.sort(rng.uniform(0, STATES[-1][2], count)).round(6)
    T = extrapolate(np.eye(4), TWIST, t).pose @ MOUNTED.matrix()
    rays = rng.normal(size=(count, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    towards, origin = np.einsum("nij,nj->ni", T[:, :3, :3], rays), T[:, :3, 3]
    with np.errstate(divide="ignore"):
        ranges = np.array([(d - origin @ n) / (towards @ n) for n, d in WALLS])
    ranges[ranges <= 0] = np.inf
    wall = ranges.argmin(axis=0)
    return t, rays * (ranges.min(axis=0) + 0.01 * rng.normal(size=count))[:, None], wall.tolist()


def estimate(t: Array, points: Array, walls: list[int], at_own_times: bool) -> GaussianProcess:
    """Solve for the motion, each point at its own time or all at the start of their scan."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for pose, velocity, _ in STATES:
        values.insert(pose, gtsam.Pose3())
        values.insert(velocity, np.zeros(6))
    for state_i, state_j in pairwise(STATES):
        graph.add(WnoaPriorFactor(state_i, state_j, QC))
    for when, point, wall in zip(t, points, walls, strict=True):
        before = min(int(when / SCAN), len(STATES) - 2)
        key = 0 if at_own_times else STATES[before][0]  # 0 stands for the pose at its time
        on_wall = PointToPlaneFactor(point, *WALLS[wall], NOISE, key, MOUNTED)
        if at_own_times:
            graph.add(InterpolatedFactor(on_wall, STATES[before], STATES[before + 1], when))
        else:
            graph.add(on_wall)
    solved = optimize(graph, values, gtsam.LevenbergMarquardtParams())
    return GaussianProcess(STATES, solved, QC)


def main(plot: Path | None = None) -> tuple[Array, Array]:
    """Return the errors (n, 6) with each point at its own time, and with whole scans."""
    data, t = measure(np.random.default_rng(0), 1500), np.linspace(0, 0.5, 101)
    truth = se3_inverse(extrapolate(np.eye(4), TWIST, t).pose)
    own, scans = (se3_log(truth @ estimate(*data, each).pose(t)) for each in (True, False))
    for name, errors in (("points at their own times", own), ("whole scans", scans)):
        largest = np.linalg.norm(errors[:, 3:], axis=1).max()
        print(f"{name}: largest position error {1e3 * largest:.1f} mm")
    if plot:
        save_plot(plot, t, own, scans)
    return own, scans


def save_plot(path: Path, t: Array, own: Array, scans: Array) -> None:
    """Position errors of both."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    axes.semilogy(t, 1e3 * np.linalg.norm(scans[:, 3:], axis=1), label="whole scans")
    axes.semilogy(t, 1e3 * np.linalg.norm(own[:, 3:], axis=1), label="points at their own times")
    axes.set(xlabel="time (s)", ylabel="position error (mm)")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
