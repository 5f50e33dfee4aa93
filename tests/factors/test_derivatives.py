"""All factors: the linearisation is the exact derivative, and GTSAM's own factors agree."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import gtsam
import numpy as np
from graphs import (
    CAMERA,
    NOISE,
    QC,
    assert_derivatives_match,
    pose_between,
    random_states,
    seeds,
)
from gtsam.symbol_shorthand import L, V, X
from hypothesis import given, settings
from hypothesis import strategies as st

from factors import (
    EuclideanVelocityFactor,
    InterpolatedStereoFactor,
    ReprojectionVelocityFactor,
    StereoReprojectionFactor,
    WnoaPriorFactor,
    wnoa_square_root_information,
)
from factors.lie import se3_adjoint, se3_exp, se3_inverse
from factors.wnoa import wnoa_error

examples = settings(deadline=None, max_examples=15)
measurement = np.array([180.0, 120.0, 6.0])
MOUNTED = se3_exp([0.1, -0.2, 0.15, 0.05, -0.1, 0.2])
ROBUST = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.345), NOISE)


@given(seeds, st.floats(1e-3, 0.5))
@examples
def test_wnoa_prior(seed: int, dt: float) -> None:
    values = random_states(seed, dt)
    factor = WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, QC)
    assert_derivatives_match(factor, values)
    native = gtsam.WnoaMotionFactorPose3(
        gtsam.StateData(X(0), V(0), 0.0), gtsam.StateData(X(1), V(1), dt), QC
    )
    if QC.min() * dt**2 / 2 > 1e-9:  # below, GTSAM drops the correlation
        np.testing.assert_allclose(factor.error(values), native.error(values), rtol=1e-8)


@given(seeds, st.floats(1e-6, 0.5), st.booleans())
@examples
def test_the_prior_is_whitened_by_the_square_root_of_its_information(
    seed: int, dt: float, diagonal: bool
) -> None:
    values = random_states(seed, dt)
    A = np.random.default_rng(seed).normal(size=(6, 6))
    qc = QC if diagonal else A @ A.T + np.eye(6)
    T_i, T_j = (values.atPose3(X(k)).matrix() for k in range(2))
    error, jacobian = wnoa_error(T_i, values.atVector(V(0)), T_j, values.atVector(V(1)), dt)
    S = wnoa_square_root_information(dt, qc)
    whitened, b = WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, qc).linearize(values).jacobian()
    np.testing.assert_allclose(whitened, S @ jacobian, atol=1e-13 * np.abs(whitened).max())
    np.testing.assert_allclose(b, -S @ error, rtol=1e-12, atol=1e-12 * np.abs(b).max())


def test_threads_do_not_see_each_others_derivatives() -> None:
    """Factors of one shape share the memory that they hand to GTSAM."""
    values = [random_states(seed, 0.1) for seed in range(2)]
    factor = WnoaPriorFactor(X(0), V(0), X(1), V(1), 0.1, QC)
    expected = [factor.linearize(each).jacobian()[0] for each in values]

    def wrong(n: int) -> int:
        found = (factor.linearize(values[n]).jacobian()[0] for _ in range(2000))
        return sum(not np.array_equal(A, expected[n]) for A in found)

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            assert list(pool.map(wrong, range(2))) == [0, 0]
    finally:
        sys.setswitchinterval(before)


def test_the_papers_first_order_derivatives_are_an_option() -> None:
    """E_21 and E_23 are off by what is first order in the motion, so by half at half of dt."""
    errors = []
    for dt in (0.2, 0.1, 0.05):
        values, keys = random_states(1, dt), (X(0), V(0), X(1), V(1))
        exact, _ = WnoaPriorFactor(*keys, dt, QC).linearize(values).jacobian()
        paper, _ = WnoaPriorFactor(*keys, dt, QC, True).linearize(values).jacobian()
        whitening = wnoa_square_root_information(dt, QC)
        errors.append(np.abs(np.linalg.solve(whitening, paper - exact)).max())
    assert errors[0] > 1e-2
    np.testing.assert_allclose(errors[1:], [errors[0] / 2, errors[0] / 4], rtol=0.2)


@given(seeds, st.booleans(), st.booleans())
@examples
def test_stereo(seed: int, robust: bool, mounted: bool) -> None:
    """The loss is that of the projection in (u_left, v, disparity), the camera in the body."""
    values, T = random_states(seed, 0.1), gtsam.Pose3(MOUNTED if mounted else np.eye(4))
    model = ROBUST if robust else NOISE
    factor = StereoReprojectionFactor(measurement, model, X(0), L(0), CAMERA, T)
    if not robust:
        assert_derivatives_match(factor, values)
    point = values.atPose3(X(0)).compose(T).transformTo(values.atPoint3(L(0)))
    difference = CAMERA.project(point) - measurement
    expected = model.loss(model.squaredMahalanobisDistance(difference))
    np.testing.assert_allclose(factor.error(values), expected, rtol=1e-10)
    u_left, v, disparity = measurement
    theirs = gtsam.StereoPoint2(u_left, u_left - disparity, v)
    _, _, *rest = measurement, model, X(0), L(0), CAMERA.to_gtsam(), T
    again = StereoReprojectionFactor(theirs, factor.noiseModel(), *rest)
    np.testing.assert_allclose(again.error(values), expected, rtol=1e-10)
    np.testing.assert_allclose(again.measured, measurement, rtol=1e-15)


def test_behind_the_camera_stereo_is_as_gtsams() -> None:
    values = random_states(0, 0.1)
    values.update(L(0), values.atPose3(X(0)).matrix()[:3] @ [0.1, 0.2, -3.0, 1.0])
    unit = gtsam.noiseModel.Unit.Create(3)
    factor = StereoReprojectionFactor(measurement, unit, X(0), L(0), CAMERA)
    A, _ = factor.linearize(values).jacobian()
    np.testing.assert_array_equal(A, np.zeros((3, 9)))
    np.testing.assert_array_equal(factor.unwhitenedError(values), np.full(3, 2 * CAMERA.fx))


@given(seeds, st.floats(0.0, 1.0))
@examples
def test_interpolated_stereo(seed: int, share: float) -> None:
    values = random_states(seed, 0.2)
    keys = X(0), V(0), X(1), V(1), L(0)
    t_i, t_j = 1.0, 1.2
    t = t_i + share * (t_j - t_i) if share < 1 else t_j
    factor = InterpolatedStereoFactor(measurement, NOISE, *keys, CAMERA, t_i, t_j, t, QC)
    assert_derivatives_match(factor, values)
    values.insert(X(9), gtsam.Pose3(pose_between(values, t_i, t_j, t)))
    at_its_time = StereoReprojectionFactor(measurement, NOISE, X(9), L(0), CAMERA)
    np.testing.assert_allclose(factor.error(values), at_its_time.error(values), rtol=1e-9)


@given(seeds, st.floats(0.0, 1.0))
@examples
def test_interpolated_stereo_of_a_camera_in_the_body(seed: int, share: float) -> None:
    values, states = random_states(seed, 0.2), [gtsam.StateData(X(k), V(k), k) for k in range(2)]
    rest = L(0), CAMERA.to_gtsam(), share
    factor = InterpolatedStereoFactor(measurement, NOISE, *states, *rest, T_body_cam=MOUNTED)
    values.insert(X(9), gtsam.Pose3(pose_between(values, 0.0, 1.0, share)))
    at_its_time = StereoReprojectionFactor(measurement, NOISE, X(9), L(0), CAMERA, MOUNTED)
    np.testing.assert_allclose(factor.error(values), at_its_time.error(values), rtol=1e-9)
    assert_derivatives_match(factor, values)


@given(seeds)
@examples
def test_constant_velocity(seed: int) -> None:
    values = random_states(seed, 0.1)
    point, dt = np.array([0.4, -0.3, 4.0]), 0.03
    exact = ReprojectionVelocityFactor(measurement, NOISE, V(0), point, dt, CAMERA)
    fast = EuclideanVelocityFactor(point + 0.1, NOISE, V(0), point, dt)
    assert_derivatives_match(exact, values)
    assert_derivatives_match(fast, values)


@given(seeds)
@examples
def test_constant_velocity_of_the_body_that_carries_the_camera(seed: int) -> None:
    values, of_camera = random_states(seed, 0.1), gtsam.Values()
    of_camera.insert(V(0), se3_adjoint(se3_inverse(MOUNTED)) @ values.atVector(V(0)))
    point, unit = np.array([0.4, -0.3, 4.0]), gtsam.noiseModel.Unit.Create(3)
    for make in (
        lambda *mounted: ReprojectionVelocityFactor(
            measurement, unit, V(0), point, 0.03, CAMERA, *mounted
        ),
        lambda *mounted: EuclideanVelocityFactor(point + 0.1, unit, V(0), point, 0.03, *mounted),
    ):
        factor, expected = make(MOUNTED), make().unwhitenedError(of_camera)
        np.testing.assert_allclose(factor.unwhitenedError(values), expected, rtol=0, atol=1e-11)
        assert_derivatives_match(factor, values)


@given(seeds)
@examples
def test_constant_velocity_models_are_zero_at_the_motion(seed: int) -> None:
    velocity, point, dt = np.random.default_rng(seed).normal(size=6), np.array([0.1, 0.2, 4]), 1e-3
    later = (se3_inverse(se3_exp(dt * velocity)) @ [*point, 1.0])[:3]
    values = gtsam.Values()
    values.insert(V(0), velocity)
    unit = gtsam.noiseModel.Unit.Create(3)
    exact = ReprojectionVelocityFactor(CAMERA.project(later), unit, V(0), point, dt, CAMERA)
    fast = EuclideanVelocityFactor(later, unit, V(0), point, dt)
    assert np.abs(exact.whitenedError(values)).max() < 1e-11
    assert np.abs(fast.whitenedError(values)).max() < 20 * (dt * np.linalg.norm(velocity)) ** 2
