"""The graph as the paper writes it, every unique time a state and every landmark a point.

The structureless factor with Q_c stands for all of its states but a few: at these the mean and the
covariance are the same, and so they are at all others, which it gives back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import gtsam
import numpy as np
import pytest
from graphs import CAMERA
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray
from windows import (
    NOISE,
    QC,
    TWIST,
    Window,
    chain,
    graph_of,
    keys,
    local_step,
    mean_and_covariance,
    of_correlations,
    retracted,
    values_of,
)

from factors import StereoReprojectionFactor
from factors.lie import se3_exp

Array = NDArray[np.float64]

STANDSTILL, MOTION = 1e-4, 1.0


@dataclass(frozen=True)
class Solved:
    """States (N, 4, 4) and (N, 6) at all unique times, and covariances (N - 1, 24, 24)."""

    T: Array
    v: Array
    joint: Array
    steps: Array


@cache
def window(speed: float) -> Window:
    return Window.simulated(3, landmarks=8, seen=6, noise=1e-4, twist=speed * TWIST, seed=2)


def linearised_at(window: Window, speed: float) -> tuple[Array, Array]:
    """Poses and twists at all times."""
    twist = speed * TWIST
    return se3_exp(window.t_all[:, None] * twist), np.repeat(twist[None], len(window.t_all), axis=0)


@cache
def literal(speed: float) -> Solved:
    """By iSAM2 with QR, linearised once."""
    seen = window(speed)
    T, v = linearised_at(seen, speed)
    values = values_of(T, v)
    graph = chain(seen.t_all, 0, len(T) - 1, values, QC)
    number, points = seen.factor(0, QC).landmarks(seen.truth)
    for n, point in zip(number.tolist(), points, strict=True):
        if np.count_nonzero(seen.landmark == n) > 1:
            values.insert(L(n), point)
    at = seen.t_all.searchsorted(seen.t).tolist()
    for k, n, measured in zip(at, seen.landmark.tolist(), seen.measured, strict=True):
        if values.exists(L(n)):
            graph.push_back(StereoReprojectionFactor(measured, NOISE, X(k), L(n), CAMERA))
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    smoother = gtsam.ISAM2(parameters)
    smoother.update(graph, values)
    found = smoother.calculateEstimate()
    T_found = np.array([found.atPose3(X(k)).matrix() for k in range(len(T))])
    v_found = np.array([found.atVector(V(k)) for k in range(len(T))])
    joint = [
        smoother.jointMarginalCovariance(keys(k, k + 2)).fullMatrix() for k in range(len(T) - 1)
    ]
    return Solved(T_found, v_found, np.array(joint), local_step(T, v, T_found, v_found))


@cache
def fast(speed: float) -> Solved:
    """By the structureless factor: one Gauss-Newton step, and the states between."""
    seen = window(speed)
    factor, values = seen.factor(0, QC, tolerance=1e-15), seen.truth
    graph = graph_of(seen.chain(0, 2, QC), factor)
    step, covariance = mean_and_covariance(graph, values, keys(0, 3))
    between = factor.states_between(retracted(values, step, keys(0, 3)))
    T, v = between.states(seen.t_all)
    joint = between.joint_covariances(seen.t_all, covariance)
    return Solved(T, v, joint, local_step(*linearised_at(seen, speed), T, v))


def sigmas(solved: Solved) -> Array:
    """(N, 12) standard deviations of all states but the first, which is held."""
    variances = np.diagonal(solved.joint, axis1=1, axis2=2)
    return np.sqrt(np.concatenate([variances[:, :12], variances[-1:, 12:]]))


def test_most_of_its_times_are_those_of_measurements() -> None:
    seen = window(1.0)
    assert len(seen.t_all) >= 10 * seen.count


@pytest.mark.parametrize(("speed", "tolerance"), [(STANDSTILL, 1e-6), (MOTION, 1e-3)])
def test_means_are_those_of_the_literal_graph(speed: float, tolerance: float) -> None:
    """In standard deviations; of the step's own size even, which noise makes."""
    slow, quick = literal(speed), fast(speed)
    unit = sigmas(slow)
    steps = np.abs(slow.steps / unit).max()
    apart = np.abs(local_step(slow.T, slow.v, quick.T, quick.v) / unit).max()
    assert steps > 1e-4
    assert apart < tolerance * steps


@pytest.mark.parametrize(("speed", "tolerance"), [(STANDSTILL, 5e-6), (MOTION, 5e-3)])
def test_covariances_are_those_of_the_literal_graph(speed: float, tolerance: float) -> None:
    """Of each state with the next."""
    assert of_correlations(fast(speed).joint, literal(speed).joint) < tolerance


def test_only_the_frames_of_the_motion_prior_tell_them_apart() -> None:
    """Local variables around one state or around each: of first order in the motion."""
    apart = [of_correlations(fast(v).joint, literal(v).joint) for v in (MOTION, MOTION / 10)]
    assert apart[0] == pytest.approx(10 * apart[1], rel=0.1)
