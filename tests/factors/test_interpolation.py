"""Interpolation: what it returns at states, and that optima do not feel it."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC, durations, pose_between, random_states, seeds, state
from gtsam.symbol_shorthand import L, V, X
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import (
    InterpolatedStereoFactor,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    extrapolate,
    interpolate,
    wnoa_covariance,
    wnoa_information,
    wnoa_square_root_covariance,
    wnoa_square_root_information,
)
from factors.lie import se3_inverse, se3_log

Array = NDArray[np.float64]
examples = settings(deadline=None, max_examples=15)


@given(durations)
@examples
def test_closed_forms_of_the_prior_covariance(dt: float) -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(size=(6, 6))
    qc = A @ A.T + np.eye(6)
    covariance, scale = wnoa_covariance(dt, qc), np.repeat([dt**1.5, dt**0.5], 6)
    information = wnoa_information(dt, qc)
    root = wnoa_square_root_covariance(dt, qc)
    root_information = wnoa_square_root_information(dt, qc)
    scaled = covariance / np.outer(scale, scale)  # without units, so that one tolerance is enough
    np.testing.assert_allclose(root @ root.T / np.outer(scale, scale), scaled, atol=1e-12)
    product = (information * np.outer(scale, scale)) @ scaled
    np.testing.assert_allclose(product, np.eye(12), atol=1e-10)
    np.testing.assert_allclose(
        (root_information * scale)
        @ (root / scale[:, None])
        @ (root.T / scale)
        @ (root_information * scale).T,
        np.eye(12),
        atol=1e-10,
    )


@given(seeds, durations)
@examples
def test_interpolation_at_a_state_is_the_state(seed: int, dt: float) -> None:
    values = random_states(seed, dt)
    joint = np.diag(np.random.default_rng(seed).uniform(1, 2, 24))
    ends = interpolate(*state(values, 0), *state(values, 1), 0.0, dt, [0.0, dt], QC, joint)
    np.testing.assert_allclose(ends.pose, [state(values, k)[0] for k in range(2)], atol=1e-13)
    expected = [state(values, k)[1] for k in range(2)]
    np.testing.assert_allclose(ends.velocity, expected, rtol=1e-12, atol=1e-12 / min(dt, 1))
    np.testing.assert_array_equal(ends.covariance, [joint[:12, :12], joint[12:, 12:]])


@given(seeds, durations, st.floats(0.01, 0.99))
@examples
def test_interpolation_is_independent_of_the_world(seed: int, dt: float, share: float) -> None:
    values, world = random_states(seed, dt), random_states(seed + 1, dt).atPose3(X(1)).matrix()
    (T_i, v_i), (T_j, v_j) = state(values, 0), state(values, 1)
    here = interpolate(T_i, v_i, T_j, v_j, 0.0, dt, share * dt)
    there = interpolate(world @ T_i, v_i, world @ T_j, v_j, 0.0, dt, share * dt)
    np.testing.assert_allclose(there.pose, world @ here.pose, atol=1e-13)
    np.testing.assert_allclose(there.velocity, here.velocity, rtol=0, atol=1e-14 / dt)


@given(seeds, durations, st.floats(0, 1))
@examples
def test_extrapolation_is_interpolation_to_itself(seed: int, dt: float, share: float) -> None:
    T_i, v_i = state(random_states(seed, dt), 0)
    ahead = extrapolate(T_i, v_i, dt)
    between = interpolate(T_i, v_i, ahead.pose, ahead.velocity, 0.0, dt, share * dt)
    expected = extrapolate(T_i, v_i, share * dt)
    np.testing.assert_allclose(between.pose, expected.pose, atol=1e-13)
    np.testing.assert_allclose(between.velocity, expected.velocity, rtol=0, atol=1e-14 / dt + 1e-14)


def solve(factors: list[gtsam.NonlinearFactor], values: gtsam.Values) -> gtsam.Values:
    """Gauss-Newton with QR, driven from here to convergence."""
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    for _ in range(30):
        ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
        linear = graph.linearize(values)
        delta = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
        values = values.retract(delta)
        if delta.norm() < 1e-10:
            break
    return values


def anchored(values: gtsam.Values, count: int = 2) -> list[gtsam.NonlinearFactor]:
    """A tight prior on state 0 and loose ones on the others, of a solver's initial values."""
    factors: list[gtsam.NonlinearFactor] = []
    for k in range(count):
        sigma = 1e-3 if k == 0 else 0.1
        model = gtsam.noiseModel.Isotropic.Sigma(6, sigma)
        factors.append(gtsam.PriorFactorPose3(X(k), values.atPose3(X(k)), model))
        factors.append(gtsam.PriorFactorVector(V(k), values.atVector(V(k)), model))
    return factors


@given(seeds)
@examples
def test_an_extra_interpolated_state_does_not_move_the_optimum(seed: int) -> None:
    """Beyond what another linearisation point of the process makes: a thousandth of a sigma."""
    dt = 0.02
    values = random_states(seed, dt)
    factors = anchored(values)
    without = solve([*factors, WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, QC)], values)
    middle = interpolate(*state(without, 0), *state(without, 1), 0.0, dt, dt / 3)
    values.insert(X(2), gtsam.Pose3(middle.pose))
    values.insert(V(2), middle.velocity)
    first = WnoaPriorFactor(X(0), V(0), X(2), V(2), dt / 3, QC)
    second = WnoaPriorFactor(X(2), V(2), X(1), V(1), dt - dt / 3, QC)
    with_state = solve([*factors, first, second], values)
    for k in range(2):
        sigma = 1e-3 if k == 0 else 0.1
        moved = se3_log(se3_inverse(state(without, k)[0]) @ state(with_state, k)[0])
        assert np.abs(moved).max() < 1e-3 * sigma
    np.testing.assert_allclose(state(with_state, 2)[0], middle.pose, atol=1e-5)


@given(seeds)
@example(126)  # a depth that is known to half a metre
@examples
def test_a_factor_without_its_landmark_has_the_optimum_of_explicit_ones(seed: int) -> None:
    dt = 0.02
    values = random_states(seed, dt)
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0, dt, 6))
    poses = pose_between(values, 0.0, dt, times)
    point = poses[0] @ np.r_[rng.uniform(-1, 1, 2), rng.uniform(2, 4), 1.0]
    values.update(L(0), point[:3])
    measured = CAMERA.project((se3_inverse(poses) @ point)[:, :3])
    measured += rng.normal(size=measured.shape) * [1, 1, 0.3]
    common = [*anchored(values), WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, QC)]
    states = [(X(0), V(0), 0.0), (X(1), V(1), dt)]
    tracklet = StructurelessStereoFactor(measured, times, 0, NOISE, states, CAMERA)
    keys = X(0), V(0), X(1), V(1), L(0)
    explicit = [
        InterpolatedStereoFactor(y, NOISE, *keys, CAMERA, 0.0, dt, t)
        for y, t in zip(measured, times, strict=True)
    ]
    start = gtsam.Values(values)
    start.erase(L(0))
    eliminated, whole = solve([*common, tracklet], start), solve([*common, *explicit], values)
    for k in range(2):
        np.testing.assert_allclose(state(eliminated, k)[0], state(whole, k)[0], atol=1e-7)
        np.testing.assert_allclose(state(eliminated, k)[1], state(whole, k)[1], atol=1e-7)
    found = tracklet.landmarks(eliminated)[1]
    np.testing.assert_allclose(found[0], whole.atPoint3(L(0)), atol=1e-6)

    # States at all times instead of interpolation: the same within the process's own deviation.
    at_times = gtsam.Values(values)
    stamps, order = [0.0, *times, dt], [0, *range(2, 2 + len(times)), 1]
    every = list(anchored(values))
    for n, t in enumerate(times):
        middle = interpolate(*state(values, 0), *state(values, 1), 0.0, dt, t)
        at_times.insert(X(2 + n), gtsam.Pose3(middle.pose))
        at_times.insert(V(2 + n), middle.velocity)
        every.append(StereoReprojectionFactor(measured[n], NOISE, X(2 + n), L(0), CAMERA))
    for n in range(len(stamps) - 1):
        i, j, step = order[n], order[n + 1], stamps[n + 1] - stamps[n]
        every.append(WnoaPriorFactor(X(i), V(i), X(j), V(j), step, QC))
    reference = solve(every, at_times)
    deviation = np.sqrt(QC.max() * dt**3 / 192)
    moved = se3_log(se3_inverse(state(reference, 1)[0]) @ state(eliminated, 1)[0])
    assert np.abs(moved).max() < deviation


def test_gtsams_poses_are_as_good_as_matrices() -> None:
    values, dt = random_states(3, 0.1), 0.1
    (T_i, v_i), (T_j, v_j) = state(values, 0), state(values, 1)
    poses = [values.atPose3(X(k)) for k in range(2)]
    expected = interpolate(T_i, v_i, T_j, v_j, 0.0, dt, 0.03)
    found = interpolate(poses[0], v_i, poses[1], v_j, 0.0, dt, 0.03)
    np.testing.assert_array_equal(found.pose, expected.pose)
    np.testing.assert_array_equal(se3_log(poses), se3_log(np.stack([T_i, T_j])))
    ahead = extrapolate(poses[0], v_i, dt)
    np.testing.assert_array_equal(ahead.pose, extrapolate(T_i, v_i, dt).pose)


def test_many_covariances_of_one_state_are_taken_one_by_one() -> None:
    values = random_states(2, 0.1)
    ends, one = (*state(values, 0), *state(values, 1)), np.eye(24)
    joint = np.stack([one, 4 * one])
    found = interpolate(*ends, 0.0, 0.1, 0.04, QC, joint)
    ahead = extrapolate(*state(values, 1), 0.1, QC, joint[:, :12, :12])
    for k in range(2):
        single = interpolate(*ends, 0.0, 0.1, 0.04, QC, joint[k])
        beyond = extrapolate(*state(values, 1), 0.1, QC, joint[k, :12, :12])
        np.testing.assert_allclose(found.covariance[k], single.covariance, rtol=1e-12)
        np.testing.assert_allclose(ahead.covariance[k], beyond.covariance, rtol=1e-12)


@pytest.mark.parametrize("name", ["t_i", "t_j", "t"])
def test_times_that_are_not_finite_are_named(name: str) -> None:
    times = {"t_i": 0.0, "t_j": 0.1, "t": 0.05, name: np.inf}
    with pytest.raises(ValueError, match=f"{name} must be finite"):
        interpolate(np.eye(4), np.zeros(6), np.eye(4), np.zeros(6), **times)
