"""A factor graph by hand: a camera that moves freely, landmarks that it sees at any time.

The camera turns and moves for half a second. Landmarks are measured one by one, each at its own
microsecond, but the graph has a state every 50 ms only: the Gaussian process between the states
takes each measurement at its own time, and afterwards answers for any other time.

Run as ``python -m examples.factors_by_hand``; with a file name it also saves a plot.
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
    StereoCamera,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    extrapolate,
    interpolate,
    optimize,
)
from factors.lie import se3_inverse, se3_log

Array = NDArray[np.float64]

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
TWIST = np.array([0.2, 0.5, -0.1, 0.3, 0.1, 0.6])  # rad/s and m/s, in the camera frame
QC = np.array([0.02, 0.02, 0.02, 0.2, 0.2, 0.2])  # power spectral density of the acceleration
PIXELS = np.array([0.5, 0.5, 0.7])  # standard deviations of (u_left, v, disparity)
STATE_TIMES = np.linspace(0, 0.5, 11)


def measure(rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (12,) and noisy measurements (12, 3) of one landmark."""
    times = np.sort(rng.uniform(0, 0.5, 12)).round(6)
    point = np.r_[rng.uniform(-1, 1, 2), rng.uniform(2, 5), 1.0]
    in_camera = se3_inverse(extrapolate(np.eye(4), TWIST, times).pose) @ point
    measured = CAMERA.project(in_camera[:, :3]) + rng.normal(size=(12, 3)) * PIXELS
    return times, measured


def build(
    rng: np.random.Generator,
) -> tuple[gtsam.NonlinearFactorGraph, StructurelessStereoFactor]:
    """The graph: where it starts, how it moves, what it saw."""
    graph = gtsam.NonlinearFactorGraph()
    graph.add(
        gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4))
    )

    states = [(X(k), V(k), float(t)) for k, t in enumerate(STATE_TIMES)]
    for (pose_i, velocity_i, t_i), (pose_j, velocity_j, t_j) in pairwise(states):
        graph.add(WnoaPriorFactor(pose_i, velocity_i, pose_j, velocity_j, t_j - t_i, QC))

    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.345)
    model = gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Diagonal.Sigmas(PIXELS))
    tracks = [measure(rng) for _ in range(15)]
    times, measured = (np.concatenate(part) for part in zip(*tracks, strict=True))
    landmarks = np.repeat(np.arange(15), 12)
    seen = StructurelessStereoFactor(measured, times, landmarks, model, states, CAMERA)
    graph.add(seen)
    return graph, seen


def initial_values() -> gtsam.Values:
    """A camera that does not move."""
    values = gtsam.Values()
    for k in range(len(STATE_TIMES)):
        values.insert(X(k), gtsam.Pose3())
        values.insert(V(k), np.zeros(6))
    return values


def query(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, t: Array) -> tuple[Array, Array]:
    """Poses (n, 4, 4) and covariances (n, 6, 6) at any times (n,) between the states."""
    i = np.clip(np.searchsorted(STATE_TIMES, t, side="right") - 1, 0, len(STATE_TIMES) - 2)
    T = np.array([values.atPose3(X(k)).matrix() for k in range(len(STATE_TIMES))])
    v = np.array([values.atVector(V(k)) for k in range(len(STATE_TIMES))])
    joint = joint_covariances(graph, values)
    state = interpolate(
        T[i], v[i], T[i + 1], v[i + 1], STATE_TIMES[i], STATE_TIMES[i + 1], t, QC, joint[i]
    )
    assert state.covariance is not None
    return state.pose, state.covariance[:, :6, :6]


def joint_covariances(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> Array:
    """(n, 24, 24) covariances of each state and the next one.

    From the R of the whole graph's QR: with states close in time GTSAM's Marginals, which use
    Cholesky, can fail.
    """
    ordering = gtsam.Ordering()
    for k in range(len(STATE_TIMES)):
        ordering.push_back(X(k))
        ordering.push_back(V(k))
    J, _ = graph.linearize(values).jacobian(ordering)
    inverse = np.linalg.inv(np.linalg.qr(J, mode="r"))
    covariance = inverse @ inverse.T
    blocks = range(0, len(covariance) - 12, 12)
    return np.array([covariance[n : n + 24, n : n + 24] for n in blocks])


def main(plot: Path | None = None) -> Array:
    """Solve, ask every millisecond, and compare with the truth: errors (n, 6) in sigmas."""
    graph, seen = build(np.random.default_rng(0))
    values = optimize(graph, initial_values())
    print("the first landmark is at", seen.landmarks(values)[1][0].round(3))

    t = np.linspace(0.001, 0.499, 499)
    poses, covariances = query(graph, values, t)
    errors = se3_log(se3_inverse(poses) @ extrapolate(np.eye(4), TWIST, t).pose)
    sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    print(f"largest position error {1e3 * np.linalg.norm(errors[:, 3:], axis=1).max():.2f} mm")
    if plot:
        save_plot(plot, t, errors, sigmas)
    return errors / sigmas


def save_plot(path: Path, t: Array, errors: Array, sigmas: Array) -> None:
    """Errors of the position within three standard deviations."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, sharex=True)
    for axis, k, name in zip(axes, range(3, 6), "xyz", strict=True):
        axis.fill_between(1e3 * t, -3e3 * sigmas[:, k], 3e3 * sigmas[:, k], alpha=0.3)
        axis.plot(1e3 * t, 1e3 * errors[:, k])
        axis.set_ylabel(f"{name} (mm)")
    axes[-1].set_xlabel("time (ms)")
    figure.savefig(path)
    pyplot.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
