"""Factors at a time between two states: those of a state at that time, exactly differentiated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC, assert_derivatives_match, random_states, seeds, state
from gtsam.symbol_shorthand import B, L, V, X
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from test_covariance import inverse_information, whitened_prior
from test_oracle import Oracle, oracle, relative_difference  # noqa: F401

from factors import (
    ErrorFunction,
    InterpolatedFactor,
    InterpolatedStereoFactor,
    PointToPlaneFactor,
    PointToPointFactor,
    StereoReprojectionFactor,
    WnoaPriorFactor,
    interpolate,
)
from factors.kernels.between import information_between_kernel, state_between_kernel
from factors.lie import se3_exp
from factors.wnoa import whitening

Array = NDArray[np.float64]

DT, P, W = 0.2, X(70), V(70)  # the keys that stand for the pose and the twist at t
STATES = [gtsam.StateData(X(k), V(k), DT * k) for k in range(2)]
KEYS = [X(0), V(0), X(1), V(1)]
MOUNTED = gtsam.Pose3(se3_exp([0.1, -0.2, 0.15, 0.05, -0.1, 0.2]))
Diagonal, Huber = gtsam.noiseModel.Diagonal, gtsam.noiseModel.mEstimator.Huber


def noise(size: int) -> gtsam.noiseModel.Gaussian:
    A = np.random.default_rng(size).normal(size=(size, size))
    return gtsam.noiseModel.Gaussian.Covariance(A @ A.T + np.eye(size))


def speedometer(_: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
    """Forward speed, less a bias."""
    if jacobians is not None:
        jacobians[0], jacobians[1] = np.eye(6)[3:4], -np.eye(1)
    return values.atVector(W)[3:4] - values.atVector(B(0)) - 0.7


up, point = gtsam.Unit3(np.array([0.1, 0.2, 1.0])), np.array([0.3, -0.2, 2.5])
distorted = gtsam.Cal3DS2(200, 210, 0.5, 100, 90, 0.01, -0.002, 0.001, 0.0005)
fisheye = gtsam.Cal3Fisheye(200, 210, 0.5, 100, 90, 0.01, -0.002, 0.001, 0.0005)
pinhole, pixel = gtsam.Cal3_S2(200, 210, 0.5, 100, 90), np.array([110.0, 95.0])
INNER: dict[str, Callable[[], Any]] = {
    "gps": lambda: gtsam.GPSFactor(P, point, noise(3)),
    "range": lambda: gtsam.RangeFactor3D(P, L(0), 2.0, noise(1)),
    "bearing": lambda: gtsam.BearingFactor3D(P, L(0), up, noise(2)),
    "bearing and range": lambda: gtsam.BearingRangeFactor3D(P, L(0), up, 2.0, noise(3)),
    "projection": lambda: gtsam.GenericProjectionFactorCal3_S2(
        pixel, noise(2), P, L(0), pinhole, MOUNTED
    ),
    "distorted": lambda: gtsam.GenericProjectionFactorCal3DS2(pixel, noise(2), P, L(0), distorted),
    "fisheye": lambda: gtsam.GenericProjectionFactorCal3Fisheye(pixel, noise(2), P, L(0), fisheye),
    "pose": lambda: gtsam.PriorFactorPose3(P, MOUNTED, noise(6)),
    "between": lambda: gtsam.BetweenFactorPose3(P, X(5), MOUNTED, noise(6)),
    "to a state of its own": lambda: gtsam.BetweenFactorPose3(P, X(1), MOUNTED, noise(6)),
    "stereo": lambda: StereoReprojectionFactor([180, 120, 6], NOISE, P, L(0), CAMERA, MOUNTED),
    "point to point": lambda: PointToPointFactor(point, L(0), noise(3), P, MOUNTED),
    "to a fixed point": lambda: PointToPointFactor(point, 2 * point, noise(3), P),
    "point to plane": lambda: PointToPlaneFactor(point, [0.6, 0, 0.8], 0.3, noise(1), P, MOUNTED),
}
WITH_TWIST: dict[str, Callable[[], Any]] = {
    "motion": lambda: WnoaPriorFactor(P, W, X(5), V(5), 0.1, QC),
    "speed": lambda: ErrorFunction(noise(1), [W, B(0), P], speedometer_at),
    "speed, custom": lambda: gtsam.CustomFactor(noise(1), [W, B(0), P], speedometer_at),
    "twist": lambda: gtsam.PriorFactorVector(W, np.arange(6.0), noise(6)),
}


def speedometer_at(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
    """The same, with a pose that it does not need."""
    if jacobians is not None:
        jacobians[2] = np.zeros((1, 6))
    return speedometer(this, values, jacobians)


def values_of(seed: int) -> gtsam.Values:
    """Two states, the landmark before them, and what else the inner factors read."""
    values = random_states(seed, DT)
    values.insert(X(5), gtsam.Pose3(se3_exp(np.random.default_rng(seed).normal(size=6))))
    values.insert(V(5), np.random.default_rng(seed).normal(size=6))
    values.insert(B(0), np.array([0.1]))
    return values


def with_state_at(values: gtsam.Values, t: float) -> gtsam.Values:
    found = interpolate(*state(values, 0), *state(values, 1), 0.0, DT, t)
    both = gtsam.Values(values)
    both.insert(P, gtsam.Pose3(found.pose))
    both.insert(W, found.velocity)
    return both


def inner_error(inner: Any, values: gtsam.Values) -> Array:
    if isinstance(inner, ErrorFunction):
        return inner.error(None, values, None)
    return np.asarray(inner.unwhitenedError(values))


@pytest.mark.parametrize("name", INNER)
@given(seed=seeds, share=st.floats(0, 1))
@settings(deadline=None, max_examples=5)
def test_it_is_the_inner_factor_at_its_time(name: str, seed: int, share: float) -> None:
    inner, values, t = INNER[name](), values_of(seed), min(share * DT, DT)
    if name == "to a state of its own":  # which it does not move against, there
        t = min(t, 0.9 * DT)
    factor = InterpolatedFactor(inner, *STATES, t)
    expected = inner_error(inner, with_state_at(values, t))
    np.testing.assert_allclose(factor.unwhitenedError(values), expected, rtol=1e-9, atol=1e-9)
    if not name.startswith("bearing"):  # GTSAM's own Jacobian of a bearing is not exact
        assert_derivatives_match(factor, values, tolerance=1e-9)


@pytest.mark.parametrize("name", INNER)
@given(seed=seeds, share=st.floats(0, 1))
@settings(deadline=None, max_examples=3)
def test_its_jacobian_is_the_inner_one_times_that_of_the_state(
    name: str, seed: int, share: float
) -> None:
    inner, values, t = INNER[name](), values_of(seed), min(share * DT, DT)
    factor, at_t = InterpolatedFactor(inner, *STATES, t), with_state_at(values, t)
    T, v = np.empty((4, 4)), np.empty(6)
    by_ends = state_between_kernel(*state(values, 0), *state(values, 1), t, DT - t, T, v)[:6]
    A = inner.linearize(at_t).jacobian()[0]
    expected = {key: A[:, :6] @ by_ends[:, 6 * k : 6 * k + 6] for k, key in enumerate(KEYS)}
    for other in tuple(inner.keys())[1:]:
        expected[other] = A[:, 6:] + expected.get(other, 0)
    found = factor.linearize(values).jacobian()[0]
    whole = np.hstack([expected[key] for key in tuple(factor.keys())])
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-11 * np.abs(A).max())


@pytest.mark.parametrize("name", WITH_TWIST)
@given(seed=seeds, share=st.floats(0, 1))
@settings(deadline=None, max_examples=5)
def test_the_twist_at_its_time_is_interpolated_too(name: str, seed: int, share: float) -> None:
    inner, values, t = WITH_TWIST[name](), values_of(seed), min(share * DT, DT)
    pose = None if name == "twist" else P
    factor = InterpolatedFactor(inner, *STATES, t, pose=pose, velocity=W)
    expected = inner_error(inner, with_state_at(values, t))
    np.testing.assert_allclose(factor.unwhitenedError(values), expected, rtol=1e-9, atol=1e-9)
    assert_derivatives_match(factor, values, tolerance=1e-9)


@given(seed=seeds, share=st.floats(0.1, 0.9))
@settings(deadline=None, max_examples=5)
def test_it_is_our_own_interpolated_stereo_factor(seed: int, share: float) -> None:
    values, measured, t = values_of(seed), [180.0, 120.0, 6.0], share * DT
    one = InterpolatedStereoFactor(measured, NOISE, *STATES, L(0), CAMERA, t, None, MOUNTED)
    inner = StereoReprojectionFactor(measured, NOISE, 0, L(0), CAMERA, MOUNTED)
    other = InterpolatedFactor(inner, *STATES, t)
    np.testing.assert_allclose(other.error(values), one.error(values), rtol=1e-9)
    A, b = one.linearize(values).jacobian()
    A_other, b_other = other.linearize(values).jacobian()
    scale = np.abs(A.T @ A).max()
    np.testing.assert_allclose(A_other.T @ A_other, A.T @ A, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(A_other.T @ b_other, A.T @ b, rtol=0, atol=1e-10 * scale)


def test_factors_hold_factors() -> None:
    """The step between two times of their own, each between two states."""
    values = random_states(3, DT, 3)
    third = gtsam.StateData(X(2), V(2), 2 * DT)
    step = gtsam.BetweenFactorPose3(100, 101, MOUNTED, noise(6))
    half = InterpolatedFactor(step, *STATES, 0.08, pose=100)
    whole = InterpolatedFactor(half, STATES[1], third, DT + 0.05, pose=101)
    T = [
        gtsam.Pose3(interpolate(*state(values, k), *state(values, k + 1), 0, DT, t).pose)
        for k, t in ((0, 0.08), (1, 0.05))
    ]
    expected = MOUNTED.localCoordinates(T[0].between(T[1]))
    np.testing.assert_allclose(whole.unwhitenedError(values), expected, atol=1e-12)
    assert set(whole.keys()) == {X(0), V(0), X(1), V(1), X(2), V(2)}
    assert_derivatives_match(whole, values, tolerance=1e-9)


@pytest.mark.parametrize("model", [Huber.Create(0.1), gtsam.noiseModel.mEstimator.Tukey.Create(2)])
def test_robust_noise_counts(model: Any) -> None:
    """Where GTSAM's own interpolated factor crashes."""
    values, robust = values_of(1), gtsam.noiseModel.Robust.Create(model, noise(3))
    factor = InterpolatedFactor(gtsam.GPSFactor(0, point, robust), *STATES, 0.1)
    plain = InterpolatedFactor(gtsam.GPSFactor(0, point, noise(3)), *STATES, 0.1)
    distance = np.linalg.norm(plain.whitenedError(values))
    np.testing.assert_allclose(factor.error(values), model.loss(distance), rtol=1e-12)
    A, b = plain.linearize(values).jacobian()
    A_robust, b_robust = factor.linearize(values).jacobian()
    root = np.sqrt(model.weight(distance))
    np.testing.assert_allclose(A_robust, root * A, rtol=1e-12)
    np.testing.assert_allclose(b_robust, root * b, rtol=1e-12)


def test_jacobian_of_the_state_between(oracle: Oracle) -> None:  # noqa: F811
    T, v = np.empty((4, 4)), np.empty(6)
    ends = oracle.T_i, oracle.v_i, oracle.T_j, oracle.v_j
    tau = float(oracle.tau)
    found = state_between_kernel(*ends, tau, float(oracle.dt) - tau, T, v)
    assert relative_difference(T, oracle.pose) < 1e-13
    assert relative_difference(v, oracle.velocity) < 1e-13
    assert relative_difference(found[:6], oracle.by_states[:6]) < 1e-13
    assert relative_difference(found[6:], oracle.by_states[6:]) < 1e-13


@pytest.mark.parametrize("dt", [1e-6, 1e-4, 1e-2, 0.5])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.97])
def test_covariance_given_both_states_to_60_digits(dt: float, share: float) -> None:
    values = random_states(5, dt)
    ends = (*state(values, 0), *state(values, 1))
    a = share * dt
    T, v, _ = interpolate(*ends, 0.0, dt, a)
    t = np.array([a, dt - a])
    information = information_between_kernel(*ends[:2], T, v, *ends[2:], t, whitening(QC))
    own = np.vstack(
        [
            whitened_prior(ends[:2], (T, v), a, QC)[:, 12:],
            whitened_prior((T, v), ends[2:], dt - a, QC)[:, :12],
        ]
    )
    expected = inverse_information(own)
    sigmas = np.sqrt(np.diag(expected))
    found = np.linalg.inv(information * np.outer(sigmas, sigmas))
    np.testing.assert_allclose(found, expected / np.outer(sigmas, sigmas), rtol=0, atol=1e-10)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("t", [0.0, 0.05, DT])
def test_the_noise_of_the_state_between_is_added(t: float, robust: bool) -> None:
    values, loss = values_of(4), Huber.Create(0.2)
    model = gtsam.noiseModel.Robust.Create(loss, noise(3)) if robust else noise(3)
    gps, qc = gtsam.GPSFactor(0, point, model), 1e7 * QC
    factor = InterpolatedFactor(gps, *STATES, t, qc=qc)
    plain = InterpolatedFactor(gtsam.GPSFactor(0, point, noise(3)), *STATES, t)
    error = plain.unwhitenedError(values)
    T, v, _ = interpolate(*state(values, 0), *state(values, 1), 0.0, DT, t)
    ends = (*state(values, 0), *state(values, 1))
    covariance = noise(3).covariance()
    if t not in (0.0, DT):
        both = np.array([t, DT - t])
        information = information_between_kernel(*ends[:2], T, v, *ends[2:], both, whitening(qc))
        covariance += T[:3, :3] @ np.linalg.inv(information)[3:6, 3:6] @ T[:3, :3].T
    distance = np.sqrt(error @ np.linalg.solve(covariance, error))
    expected = loss.loss(distance) if robust else distance**2 / 2
    np.testing.assert_allclose(factor.error(values), expected, rtol=1e-10)
    if not robust:
        J = plain.linearize(values).jacobian()[0]
        H = np.linalg.inv(noise(3).R()) @ J
        A = factor.linearize(values).jacobian()[0]
        information = H.T @ np.linalg.solve(covariance, H)
        np.testing.assert_allclose(A.T @ A, information, atol=1e-10 * np.abs(information).max())
    if t not in (0.0, DT):
        assert factor.error(values) < 0.99 * InterpolatedFactor(gps, *STATES, t).error(values)


def test_bad_input_is_refused_by_name() -> None:
    gps = gtsam.GPSFactor(0, point, noise(3))
    zero = gtsam.GPSFactor(0, point, gtsam.noiseModel.Constrained.All(3))
    for name, make in (
        ("t = ", lambda: InterpolatedFactor(gps, *STATES, -0.1)),
        ("t = ", lambda: InterpolatedFactor(gps, *STATES, np.nan)),
        ("pose must be a key", lambda: InterpolatedFactor(gps, *STATES, 0.1, pose=4)),
        ("velocity must be a key", lambda: InterpolatedFactor(gps, *STATES, 0.1, velocity=4)),
        (
            "inner must have keys",
            lambda: InterpolatedFactor(ErrorFunction(*[noise(1), [], min]), *STATES, 0.1),
        ),
        (
            "inner must have keys, each once, not 0 0",
            lambda: InterpolatedFactor(
                gtsam.BetweenFactorPose3(0, 0, MOUNTED, noise(6)), *STATES, 0.1
            ),
        ),
        (
            "inner must have a noise model",
            lambda: InterpolatedFactor(ErrorFunction(*[None, [0], min]), *STATES, 0.1),
        ),
        ("inner must be", lambda: InterpolatedFactor(3, *STATES, 0.1)),  # type: ignore[arg-type]
        ("qc", lambda: InterpolatedFactor(gps, *STATES, 0.1, qc=-QC)),
        ("Constrained", lambda: InterpolatedFactor(zero, *STATES, 0.1, qc=QC)),
        ("normal", lambda: PointToPlaneFactor(point, [1, 1, 0], 0.0, noise(1), 0)),
        ("distance", lambda: PointToPlaneFactor(point, [1, 0, 0], np.nan, noise(1), 0)),
        ("target", lambda: PointToPointFactor(point, [1, 0], noise(3), 0)),
        ("T_body_sensor", lambda: PointToPointFactor(point, point, noise(3), 0, 2 * np.eye(4))),
    ):
        with pytest.raises(ValueError, match=name):
            make()


def constant_error(error: Any, *jacobians: Array) -> ErrorFunction:
    def function(_: Any, _values: gtsam.Values, found: Any) -> Any:
        for k, jacobian in enumerate(jacobians if found is not None else ()):
            found[k] = jacobian
        return error

    return ErrorFunction(noise(3), [P, W][: max(len(jacobians), 1)], function)


@pytest.mark.parametrize(
    ("fault", "inner"),
    [
        (r"must return \(3,\)", constant_error(np.zeros(2), np.eye(3, 6))),
        (r"must return \(3,\)", constant_error(np.zeros((3, 1)), np.eye(3, 6))),
        ("must be real numbers", constant_error("none", np.eye(3, 6))),
        ("must set jacobians", constant_error(np.zeros(3))),
        ("must set jacobians", constant_error(np.zeros(3), np.eye(1, 6))),
        (r"\[\(3, 6\)\], not \[\(3, 5\)\]", constant_error(np.zeros(3), np.eye(3, 5))),
        (r"not \[\(3, 6\), \(3, 7\)\]", constant_error(np.zeros(3), np.eye(3, 6), np.eye(3, 7))),
        (
            "must set jacobians",
            ErrorFunction(noise(3), [P], lambda _, __, H: H.clear() or np.zeros(3)),
        ),
    ],
)
def test_a_wrong_error_function_is_refused_and_not_read_beyond_its_end(
    fault: str, inner: ErrorFunction
) -> None:
    velocity = W if len(inner.keys) > 1 else None
    for qc in (None, QC):
        factor = InterpolatedFactor(inner, *STATES, 0.1, velocity=velocity, qc=qc)
        for _ in range(2):
            with pytest.raises(ValueError, match=fault):
                factor.linearize(values_of(0))


def test_a_value_of_another_type_is_named() -> None:
    values = values_of(0)
    values.erase(L(0))
    factor = InterpolatedFactor(INNER["range"](), *STATES, 0.1)
    with pytest.raises(ValueError, match=r"l0 .of inner. is not in the values"):
        factor.error(values)
    values.insert(L(0), gtsam.Rot3())
    with pytest.raises(ValueError, match=r"RangeFactor3D on .* l0: .*Rot3"):
        factor.error(values)


def test_constrained_noise_of_a_native_factor_is_kept() -> None:
    values = values_of(0)
    zero = gtsam.GPSFactor(0, point, gtsam.noiseModel.Constrained.All(3))
    factor = InterpolatedFactor(zero, *STATES, 0.1)
    linear = factor.linearize(values)
    assert isinstance(factor.noiseModel(), gtsam.noiseModel.Constrained)
    np.testing.assert_allclose(linear.jacobian()[1], -factor.unwhitenedError(values), rtol=1e-12)


def test_the_pose_at_t_is_by_default_the_first_key_that_no_state_has() -> None:
    values, T = random_states(0, DT), gtsam.Pose3(se3_exp(np.full(6, 0.1)))
    later = gtsam.BetweenFactorPose3(X(0), P, T, noise(6))
    found = InterpolatedFactor(later, *STATES, 0.07)
    expected = InterpolatedFactor(later, *STATES, 0.07, pose=P)
    assert found.equals(expected)
    assert_derivatives_match(found, values)
