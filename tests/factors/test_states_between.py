"""The states at the measurements' own times, given back after the graph was solved."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA
from numpy.typing import NDArray
from windows import (
    NOISE,
    QC,
    TWIST,
    Window,
    graph_of,
    keys,
    local_step,
    mean_and_covariance,
    moved_world,
    of_correlations,
    retracted,
)

from factors import LandmarkPrior, StatesBetween, StructurelessStereoFactor, interpolate
from factors.lie import se3_exp

Array = NDArray[np.float64]

WINDOW = Window.simulated(count=4, landmarks=10, seen=6, noise=1.0, qc=QC)
PROCESS = pytest.mark.parametrize("qc", [None, QC], ids=["interpolated", "own states"])


def solved(
    factor: StructurelessStereoFactor, window: Window = WINDOW, qc: Array = QC
) -> tuple[gtsam.Values, Array, StatesBetween]:
    """Values after two steps, their covariance, and the states between them."""
    graph, values = graph_of(window.chain(0, 3, qc), factor), window.truth
    for _ in range(2):
        step, covariance = mean_and_covariance(graph, values, keys(0, 4))
        values = retracted(values, step, keys(0, 4))
    return values, covariance, factor.states_between(values)


def states_of(values: gtsam.Values) -> tuple[Array, Array]:
    T = np.array([values.atPose3(key).matrix() for key in keys(0, 4)[::2]])
    return T, np.array([values.atVector(key) for key in keys(0, 4)[1::2]])


def interpolated(values: gtsam.Values, t: Array, joint: Array | None = None) -> Any:
    """Without any measurement, and with their covariance where `joint` (3, 24, 24) is given."""
    (T, v), stamps = states_of(values), WINDOW.t_states
    i = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, 2)
    covariance = {} if joint is None else {"qc": QC, "joint_covariance": joint[i]}
    ends = T[i], v[i], T[i + 1], v[i + 1], stamps[i], stamps[i + 1]
    return interpolate(*ends, t, **covariance)


def joint_of(covariance: Array) -> Array:
    """(3, 24, 24) of each state and the next."""
    return np.array([covariance[k : k + 24, k : k + 24] for k in (0, 12, 24)])


@PROCESS
def test_at_the_states_they_are_the_states(qc: Any) -> None:
    values, covariance, between = solved(WINDOW.factor(0, qc, LandmarkPrior.none()))
    T, v = between.states(WINDOW.t_states)
    T_states, v_states = states_of(values)
    np.testing.assert_allclose(T, T_states, rtol=0, atol=1e-12)
    np.testing.assert_allclose(v, v_states, rtol=0, atol=1e-10)
    joint = between.joint_covariances(WINDOW.t_states, covariance)
    assert of_correlations(joint, joint_of(covariance)) < 1e-9


def test_by_default_they_are_at_all_times_of_measurements() -> None:
    _, _, between = solved(WINDOW.factor(0, QC))
    np.testing.assert_array_equal(between.t, np.unique(WINDOW.t))
    for found, expected in zip(between.states(), between.states(between.t), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_they_are_as_near_to_the_truth_as_their_covariance_says() -> None:
    """Where the camera shakes; nearer than the interpolation."""
    qc, squares, errors = 100 * QC, [], []
    for seed in range(8):
        window = Window.simulated(4, 15, noise=1.0, qc=qc, seed=seed)
        values, covariance, between = solved(window.factor(0, qc, None, 1e-4), window, qc)
        t, truth = window.t_all[5:], (window.T_all[5:-1], window.v_all[5:-1])
        T, v = between.states(t[:-1])
        spread = between.joint_covariances(t, covariance)[:, :12, :12]
        apart = local_step(T, v, *truth)
        squares.append(np.einsum("ni,nij,nj->n", apart, np.linalg.inv(spread), apart).mean())
        straight = interpolated(values, t[:-1])
        without = local_step(straight.pose, straight.velocity, *truth)
        errors.append([np.mean(each[:, :3] ** 2) for each in (apart, without)])
    assert 8 < np.mean(squares) < 16  # 12 degrees of freedom, alike within a window
    found, interpolation = np.sqrt(np.mean(errors, axis=0))
    assert found < 0.9 * interpolation


def test_without_qc_they_are_interpolated() -> None:
    values, covariance, between = solved(WINDOW.factor(0, None))
    t = WINDOW.t_all
    T, v = between.states(t)
    straight = interpolated(values, t)
    np.testing.assert_allclose(T, straight.pose, atol=1e-12)
    np.testing.assert_allclose(v, straight.velocity, atol=1e-10)
    joint = between.joint_covariances(t, covariance)
    assert np.isfinite(joint).all()


@pytest.mark.parametrize(("speed", "tolerance"), [(1e-4, 1e-7), (1.0, 1e-3)])
def test_where_nothing_is_measured_the_covariance_is_that_of_the_interpolation(
    speed: float, tolerance: float
) -> None:
    """Up to the frames of the motion prior, of first order in the motion."""
    window = Window.simulated(count=4, landmarks=15, twist=speed * TWIST)
    early = window.t < window.t_states[2]
    data = window.measured[early], window.t[early], window.landmark[early]
    factor = StructurelessStereoFactor(*data, NOISE, window.states, CAMERA, QC)
    graph, values = graph_of(window.chain(0, 3), factor), window.truth
    covariance = mean_and_covariance(graph, values, keys(0, 4))[1]
    between = factor.states_between(values)
    t = np.linspace(window.t_states[2], window.t_states[3], 9)
    straight = interpolated(values, t, joint_of(covariance))
    T, v = between.states(t)
    np.testing.assert_allclose(T, straight.pose, atol=1e-12)
    np.testing.assert_allclose(v, straight.velocity, atol=1e-10)
    joint = between.joint_covariances(t, covariance)
    assert of_correlations(joint[:, :12, :12], straight.covariance[:-1]) < tolerance
    assert of_correlations(joint[:, 12:, 12:], straight.covariance[1:]) < tolerance


def test_measurements_make_them_more_certain_than_the_interpolation() -> None:
    """In any direction, given the same covariance of the states."""
    values, covariance, between = solved(WINDOW.factor(0, QC))
    t = between.t
    straight = interpolated(values, t, joint_of(covariance)).covariance[:-1]
    found = between.joint_covariances(t, covariance)[:, :12, :12]
    scale = np.sqrt(np.diagonal(straight, axis1=1, axis2=2))
    less = (straight - found) / (scale[:, :, None] * scale[:, None, :])
    assert np.diagonal(less, axis1=1, axis2=2).max() > 0.1


@PROCESS
def test_covariances_are_symmetric_and_positive_semidefinite(qc: Any) -> None:
    _, covariance, between = solved(WINDOW.factor(0, qc, LandmarkPrior.none()))
    joint = between.joint_covariances(WINDOW.t_all, covariance)
    assert joint.shape == (len(WINDOW.t_all) - 1, 24, 24)
    np.testing.assert_array_equal(joint, joint.transpose(0, 2, 1))
    sigmas = np.sqrt(np.diagonal(joint, axis1=1, axis2=2))
    correlations = joint / (sigmas[:, :, None] * sigmas[:, None, :])
    assert np.linalg.eigvalsh(correlations).min() > -1e-9
    # Of one state in two pairs it is the same.
    at_states = np.isin(WINDOW.t_all[1:-1], WINDOW.t_states)
    within = ~at_states
    same = of_correlations(joint[:-1, 12:, 12:][within], joint[1:, :12, :12][within])
    assert same < 1e-9


def test_the_tolerance_changes_little() -> None:
    exact, coarse = (WINDOW.factor(0, QC, None, tolerance) for tolerance in (1e-14, 1e-4))
    values, covariance, between = solved(exact)
    other = coarse.states_between(values)
    t = WINDOW.t_all
    joint = between.joint_covariances(t, covariance)
    assert of_correlations(other.joint_covariances(t, covariance), joint) < 0.02
    variances = np.diagonal(joint, axis1=1, axis2=2)[1:, :12]
    apart = local_step(*between.states(t[1:-1]), *other.states(t[1:-1]))
    assert (np.abs(apart) / np.sqrt(variances)).max() < 0.05


@PROCESS
def test_the_world_frame_does_not_matter(qc: Any) -> None:
    S = se3_exp(np.array([0.5, -1.0, 0.7, 2.0, -3.0, 1.0]))
    values, covariance, _ = solved(WINDOW.factor(0, qc, LandmarkPrior.none()))
    here, there = (
        WINDOW.factor(0, qc, LandmarkPrior.none()).states_between(at)
        for at in (values, moved_world(values, S))
    )
    (T, v), (T_moved, v_moved) = here.states(), there.states()
    np.testing.assert_allclose(T_moved, S @ T, rtol=0, atol=1e-8)
    np.testing.assert_allclose(v_moved, v, rtol=0, atol=1e-6)
    t = WINDOW.t_all
    found, expected = (each.joint_covariances(t, covariance) for each in (there, here))
    assert of_correlations(found, expected) < 1e-5


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_times_have_no_joint_covariance(count: int) -> None:
    _, covariance, between = solved(WINDOW.factor(0, QC))
    assert between.joint_covariances(WINDOW.t[:count], covariance).shape == (0, 24, 24)
    assert between.states(WINDOW.t[:count])[0].shape == (count, 4, 4)


@pytest.mark.parametrize("outside", [-1e-6, 1e-6])
def test_times_outside_the_states_are_refused(outside: float) -> None:
    _, _, between = solved(WINDOW.factor(0, QC))
    end = WINDOW.t_states[0] if outside < 0 else WINDOW.t_states[-1]
    t = np.sort([WINDOW.t_states[1], end + outside])
    with pytest.raises(ValueError, match="must lie within the states"):
        between.states(t)
