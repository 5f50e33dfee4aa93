"""Inertial factors of body twists, against gtsam.ImuFactor on the same data."""

from __future__ import annotations

import copy
from itertools import pairwise

import gtsam
import numpy as np
import pytest
from graphs import assert_derivatives_match, random_states, seeds
from gtsam.symbol_shorthand import B, U, V, X
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import (
    GyroFactor,
    ImuFactor,
    InterpolatedFactor,
    WnoaPriorFactor,
    extrapolate,
    optimize,
)
from factors.lie import se3_adjoint, se3_exp, se3_inverse, se3_log, skew

Array = NDArray[np.float64]

DT, RATE = 0.1, 500
STATES = [gtsam.StateData(X(k), V(k), DT * k) for k in range(2)]
MOUNTED = se3_exp([0.3, -0.2, 0.5, 0.05, -0.1, 0.02])
NOISE = gtsam.noiseModel.Isotropic.Sigma(3, 2e-3)
TWIST = np.array([0.2, 0.5, -0.1, 0.3, 0.1, 0.6])
BIAS = gtsam.imuBias.ConstantBias(np.array([0.02, -0.01, 0.03]), np.array([0.01, 0.02, -0.01]))


def parameters(mounted: bool) -> gtsam.PreintegrationParams:
    found = gtsam.PreintegrationParams.MakeSharedU(9.81)
    found.setAccelerometerCovariance(1e-4 * np.eye(3))
    found.setGyroscopeCovariance(1e-6 * np.eye(3))
    found.setIntegrationCovariance(1e-8 * np.eye(3))
    if mounted:
        found.setBodyPSensor(gtsam.Pose3(MOUNTED))
    return found


def measured(t: float, mounted: bool = False) -> tuple[Array, Array]:
    """Specific force and rate of an IMU on a body of constant twist: T(t) = T_0 Exp(t v).

    The sensor's own twist is constant, too; its acceleration in its own frame is omega x v.
    """
    twist = se3_adjoint(se3_inverse(MOUNTED)) @ TWIST if mounted else TWIST
    T = extrapolate(np.eye(4), TWIST, t).pose @ (MOUNTED if mounted else np.eye(4))
    force = np.cross(twist[:3], twist[3:]) + T[:3, :3].T @ [0, 0, 9.81]
    return force + BIAS.accelerometer(), twist[:3] + BIAS.gyroscope()


def preintegrated(
    t_i: float, t_j: float, mounted: bool = False
) -> gtsam.PreintegratedImuMeasurements:
    """All measurements from t_i to t_j, each in the middle of its interval."""
    found = gtsam.PreintegratedImuMeasurements(parameters(mounted), BIAS)
    edges = np.linspace(t_i, t_j, round((t_j - t_i) * RATE) + 1)
    for start, end in pairwise(edges):
        found.integrateMeasurement(*measured((start + end) / 2, mounted), end - start)
    return found


def values_of(seed: int) -> gtsam.Values:
    values = random_states(seed, DT)
    values.insert(B(0), BIAS + gtsam.imuBias.ConstantBias(np.full(3, 0.01), np.full(3, -0.02)))
    return values


@pytest.mark.parametrize("mounted", [False, True])
@given(seed=seeds)
@settings(deadline=None, max_examples=8)
def test_it_is_gtsams_factor_of_the_velocities_in_the_world(mounted: bool, seed: int) -> None:
    values, data = values_of(seed), preintegrated(0.0, DT, mounted)
    factor = ImuFactor(data, *STATES, B(0))
    theirs = gtsam.Values(values)
    for k in range(2):
        R = values.atPose3(X(k)).rotation().matrix()
        theirs.insert(U(k), R @ values.atVector(V(k))[3:])
    native = gtsam.ImuFactor(X(0), U(0), X(1), U(1), B(0), data)
    np.testing.assert_allclose(factor.error(values), native.error(theirs), rtol=1e-12)
    found, expected = factor.unwhitenedError(values), native.unwhitenedError(theirs)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
    for ours, exact in zip(jacobians_of(factor, values), by_twists(native, theirs), strict=True):
        np.testing.assert_allclose(ours, exact, rtol=0, atol=1e-13)


def jacobians_of(factor: ImuFactor, values: gtsam.Values) -> list[Array]:
    blocks = gtsam.JacobianVector([np.zeros((9, 6))] * 5)
    factor.evaluate(values, blocks)
    return [blocks[k] for k in range(5)]


def by_twists(native: gtsam.ImuFactor, values: gtsam.Values) -> list[Array]:
    """GTSAM's Jacobians; its velocity R v turns with the pose and moves with the twist."""
    H = [np.zeros((9, n), order="F") for n in (6, 3, 6, 3, 6)]
    pose_i, velocity_i, pose_j, velocity_j, bias = native.keys()
    poses = values.atPose3(pose_i), values.atPose3(pose_j)
    velocities = values.atVector(velocity_i), values.atVector(velocity_j)
    ends = poses[0], velocities[0], poses[1], velocities[1]
    native.evaluateError(*ends, values.atConstantBias(bias), *H)
    found = []
    for k in range(2):
        R = poses[k].rotation().matrix()
        by_twist = H[2 * k + 1] @ R
        H[2 * k][:, :3] -= by_twist @ skew(R.T @ velocities[k])
        found += [H[2 * k], np.hstack([np.zeros((9, 3)), by_twist])]
    return [*found, H[4]]


def test_errors_and_worlds_that_it_does_not_know_are_refused() -> None:
    for change in (
        lambda p: p.setImuFactorErrorMode(gtsam.ImuFactorErrorMode.ComponentWise),
        lambda p: p.setOmegaCoriolis(np.array([0, 0, 1e-3])),
    ):
        chosen = parameters(False)
        change(chosen)
        data = gtsam.PreintegratedImuMeasurements(chosen, BIAS)
        for k in range(10):
            data.integrateMeasurement(*measured(k * DT / 10), DT / 10)
        with pytest.raises(ValueError, match="Logmap"):
            ImuFactor(data, *STATES, B(0))


@given(seed=seeds, exponent=st.floats(-4, 0.5))
@example(seed=1, exponent=0.5)  # four turns: made, at least
@settings(deadline=None, max_examples=30)
def test_it_is_exact_from_a_tenth_of_a_millisecond_to_seconds(seed: int, exponent: float) -> None:
    """And at large rotations and biases, where the error and its Jacobians are large, too."""
    rng, dt = np.random.default_rng(seed), 10**exponent
    vector = gtsam.imuBias.ConstantBias
    data = gtsam.PreintegratedImuMeasurements(parameters(True), vector(*rng.normal(size=(2, 3))))
    for _ in range(20):
        data.integrateMeasurement(5 * rng.normal(size=3), 1.5 * rng.normal(size=3), dt / 20)
    ours, theirs = gtsam.Values(), gtsam.Values()
    for k in range(2):
        pose, twist = gtsam.Pose3(se3_exp(1.3 * rng.normal(size=6))), 3 * rng.normal(size=6)
        ours.insert(V(k), twist)
        theirs.insert(U(k), pose.rotation().matrix() @ twist[3:])
        for values in (ours, theirs):
            values.insert(X(k), pose)
    for values in (ours, theirs):
        values.insert(B(0), vector(np.full(3, 0.2), np.full(3, -0.1)))
    factor = ImuFactor(data, (X(0), V(0), 0.0), (X(1), V(1), data.deltaTij()), B(0))
    native = gtsam.ImuFactor(X(0), U(0), X(1), U(1), B(0), data)
    expected = native.unwhitenedError(theirs)
    # GTSAM integrates the turn in the tangent space, which has no inverse at whole turns.
    assume(np.linalg.norm(data.preintegrated()[:3]) < 6.0)
    # Of angles within 0.002 of pi the translation of GTSAM's logarithm is off by 1e-7, ours is not.
    assume(np.linalg.norm(expected[:3]) < np.pi - 0.01)
    off = np.abs(factor.unwhitenedError(ours) - expected).max()
    assert off <= 1e-12 * max(1.0, np.abs(expected).max())
    for found, exact in zip(jacobians_of(factor, ours), by_twists(native, theirs), strict=True):
        assert np.abs(found - exact).max() <= 1e-11 * max(1.0, np.abs(exact).max())


@given(seed=seeds)
@settings(deadline=None, max_examples=8)
def test_its_jacobian_is_gtsams_by_the_chain_rule(seed: int) -> None:
    """Numerically: the error of GTSAM's factor moves by it to the second order of the step."""
    values, rng = values_of(seed), np.random.default_rng(seed)
    factor = ImuFactor(preintegrated(0.0, DT), *STATES, B(0))
    A, b = factor.linearize(values).jacobian()
    direction, moved = gtsam.VectorValues(), []
    steps = {key: rng.normal(size=6) for key in tuple(factor.keys())}
    for h in (1e-4, -1e-4):
        direction = gtsam.VectorValues()
        for key, step in steps.items():
            direction.insert(key, h * step)
        moved.append(factor.whitenedError(values.retract(direction)))
    found = (moved[0] - moved[1]) / 2e-4
    expected = A @ np.concatenate(list(steps.values()))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(A).max())
    np.testing.assert_allclose(b, -factor.whitenedError(values), rtol=1e-9)


@given(seed=seeds)
@settings(deadline=None, max_examples=8)
def test_gyroscope_at_a_state_and_at_its_own_time(seed: int) -> None:
    values = values_of(seed)
    at_state = GyroFactor([0.1, 0.2, 0.3], NOISE, V(0), B(0), MOUNTED)
    expected = (
        MOUNTED[:3, :3].T @ values.atVector(V(0))[:3] + values.atConstantBias(B(0)).gyroscope()
    )
    np.testing.assert_allclose(at_state.unwhitenedError(values), expected - [0.1, 0.2, 0.3])
    assert_derivatives_match(at_state, values, tolerance=1e-9)
    inner = GyroFactor([0.1, 0.2, 0.3], NOISE, 0, B(0), MOUNTED)
    between = InterpolatedFactor(inner, *STATES, 0.037, velocity=0)
    assert_derivatives_match(between, values, tolerance=1e-9)
    assert set(between.keys()) == {X(0), V(0), X(1), V(1), B(0)}


@pytest.mark.parametrize("mounted", [False, True])
def test_a_graph_of_it_finds_motion_and_bias_as_a_graph_of_gtsams_does(mounted: bool) -> None:
    """States every 0.1 s, positions at some, an IMU of 500 Hz whose bias is not known."""
    count, rng = 11, np.random.default_rng(0)
    ours, theirs = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    start, their_start = gtsam.Values(), gtsam.Values()
    truth = extrapolate(np.eye(4), TWIST, np.arange(count) * DT).pose
    qc = np.array([1e-3] * 3 + [1e-2] * 3)
    noise = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    for k in range(count):
        for graph in (ours, theirs):
            pose = gtsam.Pose3(truth[k] @ se3_exp(1e-3 * rng.normal(size=6)))
            graph.add(gtsam.PriorFactorPose3(X(k), pose, noise))
        for values in (start, their_start):
            values.insert(X(k), gtsam.Pose3(truth[k]))
        start.insert(V(k), np.zeros(6))
        their_start.insert(U(k), np.zeros(3))
    states = [gtsam.StateData(X(k), V(k), DT * k) for k in range(count)]
    for i, j in pairwise(range(count)):
        data = preintegrated(i * DT, j * DT, mounted)
        ours.add(ImuFactor(data, states[i], states[j], B(0)))
        ours.add(WnoaPriorFactor(states[i], states[j], qc))
        theirs.add(gtsam.ImuFactor(X(i), U(i), X(j), U(j), B(0), data))
        for t in np.linspace(i * DT, j * DT, 10, endpoint=False) + 0.003:
            rate = measured(t, mounted)[1]
            T_body_imu = MOUNTED if mounted else None
            gyro = GyroFactor(rate, NOISE, 0, B(0), T_body_imu)
            ours.add(InterpolatedFactor(gyro, states[i], states[j], t, velocity=0))
    for values in (start, their_start):
        values.insert(B(0), gtsam.imuBias.ConstantBias())
    solved, reference = optimize(ours, start), optimize(theirs, their_start)
    for values, tolerance in ((solved, 0.01), (reference, 0.02)):
        bias = values.atConstantBias(B(0))
        np.testing.assert_allclose(bias.gyroscope(), BIAS.gyroscope(), atol=tolerance / 3)
        np.testing.assert_allclose(bias.accelerometer(), BIAS.accelerometer(), atol=tolerance)
    for k in range(count):
        off = se3_log(se3_inverse(truth[k]) @ solved.atPose3(X(k)).matrix())
        assert np.abs(off).max() < 3e-3
        np.testing.assert_allclose(solved.atVector(V(k)), TWIST, atol=0.01)
        world = solved.atPose3(X(k)).rotation().matrix() @ solved.atVector(V(k))[3:]
        np.testing.assert_allclose(world, reference.atVector(U(k)), atol=0.01)


def test_bad_input_is_refused_by_name() -> None:
    data = preintegrated(0.0, DT)
    for name, make in (
        ("measured", lambda: GyroFactor([1, 2], NOISE, V(0), B(0))),
        ("model", lambda: GyroFactor([1, 2, 3], gtsam.noiseModel.Unit.Create(2), V(0), B(0))),
        ("T_body_imu", lambda: GyroFactor([1, 2, 3], NOISE, V(0), B(0), 2 * np.eye(4))),
        ("must last", lambda: ImuFactor(data, STATES[0], (X(1), V(1), 2 * DT), B(0))),
        ("must last", lambda: ImuFactor(data, STATES[1], STATES[0], B(0))),
        ("must not be the key of", lambda: ImuFactor(data, *STATES, X(0))),
    ):
        with pytest.raises(ValueError, match=name):
            make()


def test_the_measurements_may_be_reset_and_integrated_on() -> None:
    data, values, twist = preintegrated(0.0, DT), gtsam.Values(), np.arange(6) / 10
    factor = ImuFactor(data, *STATES, B(0))
    for k in range(2):
        values.insert(X(k), gtsam.Pose3(se3_exp(0.1 * k * twist)))
        values.insert(V(k), twist)
    values.insert(B(0), gtsam.imuBias.ConstantBias())
    before = factor.unwhitenedError(values)
    data.resetIntegration()
    for other in (factor, copy.copy(factor)):
        np.testing.assert_array_equal(other.unwhitenedError(values), before)
