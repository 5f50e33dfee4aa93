"""GPS at its own times, between the states of a pose graph.

A vehicle has a state every half second, of an odometry that drifts. GPS comes ten times a second,
never at a state, and one fix in ten is off by metres. The graph takes each fix at its own time; the
Gaussian process through its states then tells pose and covariance at any time. Run as
``python -m examples.gps_between_states``; with a file name it also saves a plot.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import GaussianProcess, InterpolatedFactor, WnoaPriorFactor, extrapolate, optimize

Array = NDArray[np.float64]

START = gtsam.Pose3(gtsam.Rot3.Ypr(0.4, 0.0, 0.0), np.array([120.0, -40.0, 10.0]))  # in ENU
TWIST = np.array([0.0, 0.02, 0.25, 4.0, 0.1, 0.0])  # the true motion, rad/s and m/s
QC = np.array([1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-2])  # power spectral density of the acceleration
STATES = [(X(k), V(k), 0.5 * k) for k in range(21)]  # pose key, velocity key, seconds
ODOMETRY = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.01, 0.02, 0.05, 0.05, 0.05]))
HUBER = gtsam.noiseModel.mEstimator.Huber.Create(1.345)
GPS = gtsam.noiseModel.Robust.Create(HUBER, gtsam.noiseModel.Isotropic.Sigma(3, 0.3))  # metres


def build(rng: np.random.Generator) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The graph without GPS, and where its odometry leads."""
    graph, values, pose = gtsam.NonlinearFactorGraph(), gtsam.Values(), START
    loose = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.1, 0.1, 2.0, 2.0, 2.0]))
    graph.add(gtsam.PriorFactorPose3(X(0), START, loose))
    values.insert(X(0), pose)
    for (i, _, t_i), (j, _, t_j) in pairwise(STATES):
        step = gtsam.Pose3.Expmap((t_j - t_i) * TWIST + rng.normal(size=6) * ODOMETRY.sigmas())
        graph.add(gtsam.BetweenFactorPose3(i, j, step, ODOMETRY))
        pose = pose.compose(step)
        values.insert(j, pose)
    for state_i, state_j in pairwise(STATES):
        graph.add(WnoaPriorFactor(state_i, state_j, QC))
    for _, velocity, _ in STATES:
        values.insert(velocity, TWIST)
    return graph, values


def fixes(rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (95,) of GPS, and positions (95, 3) in the world, some of them wrong."""
    t = (np.arange(95) + rng.uniform(0.2, 0.8, 95)) * 0.1
    noise = rng.normal(size=(95, 3)) * 0.3
    noise[rng.permutation(95)[:9]] *= 30
    return t, truth(t)[:, :3, 3] + noise


def truth(t: Array) -> Array:
    """True poses (n, 4, 4)."""
    return extrapolate(START, TWIST, t).pose


def main(plot: Path | None = None) -> tuple[Array, Array, Array]:
    """Return position errors (n, 3) of odometry alone and with GPS, and the latter's sigmas."""
    rng, t = np.random.default_rng(0), np.linspace(0, 10, 201)
    graph, values = build(rng)
    alone = GaussianProcess(STATES, values, QC).pose(t)[:, :3, 3] - truth(t)[:, :3, 3]
    times, positions = fixes(rng)
    for when, position in zip(times, positions, strict=True):
        before = min(int(when / 0.5), len(STATES) - 2)
        fix = gtsam.GPSFactor(0, position, GPS)  # 0 stands for the pose at its time
        graph.add(InterpolatedFactor(fix, STATES[before], STATES[before + 1], when))
    solved = optimize(graph, values, gtsam.LevenbergMarquardtParams())
    trajectory = GaussianProcess(STATES, solved, QC, graph)
    pose, covariance = trajectory.pose(t), trajectory.covariance(t)[:, 3:6, 3:6]
    in_world = pose[:, :3, :3] @ covariance @ pose[:, :3, :3].transpose(0, 2, 1)
    errors = pose[:, :3, 3] - truth(t)[:, :3, 3]
    sigmas = np.sqrt(np.diagonal(in_world, axis1=1, axis2=2))
    print(f"odometry drifts by {np.linalg.norm(alone[-1]):.1f} m; with GPS at its own times the")
    print(f"largest error at any time is {np.linalg.norm(errors, axis=1).max():.2f} m")
    if plot:
        save_plot(plot, t, errors, sigmas)
    return alone, errors, sigmas


def save_plot(path: Path, t: Array, errors: Array, sigmas: Array) -> None:
    """Errors within three standard deviations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    for axes, error, sigma, name in zip(
        figure.subplots(3, sharex=True), errors.T, sigmas.T, ("east", "north", "up"), strict=True
    ):
        axes.fill_between(t, -3 * sigma, 3 * sigma, alpha=0.25, label="3 standard deviations")
        axes.plot(t, error, label="error")
        axes.set_ylabel(f"{name} (m)")
    axes.set_xlabel("time (s)")
    axes.legend(frameon=False, loc="upper center", ncols=2)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
