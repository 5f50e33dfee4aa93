"""Motion priors in all spaces, against 60 digits, numerical derivatives and GTSAM's own."""

from __future__ import annotations

import pickle
from decimal import Decimal, localcontext
from itertools import pairwise
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import assert_derivatives_match, derivative
from gtsam.symbol_shorthand import A, V, X
from numpy.typing import NDArray
from test_covariance import inverse_information
from windows import graph_of

from factors import (
    WnoaPriorFactor,
    WnoaPriorFactorPose2,
    WnoaPriorFactorRot3,
    WnoaPriorFactorVector,
    WnojPriorFactor,
    WnojPriorFactorPose2,
    WnojPriorFactorRot3,
    WnojPriorFactorVector,
    from_dict,
    interpolate,
    optimize,
    prior_covariance,
    prior_square_root_information,
    to_dict,
    wnoa_covariance,
)
from factors.kernels.jerk import local_motion_kernel, retract_motion_kernel, wnoj_kernel
from factors.lie import se3_adjoint, se3_exp, se3_right_jacobian

Array = NDArray[np.float64]

WNOA = [WnoaPriorFactor, WnoaPriorFactorPose2, WnoaPriorFactorRot3, WnoaPriorFactorVector]
WNOJ = [WnojPriorFactor, WnojPriorFactorPose2, WnojPriorFactorRot3, WnojPriorFactorVector]
SIZES = dict(zip([*WNOA, *WNOJ], [6, 3, 3, 4] * 2, strict=True))
each_prior = pytest.mark.parametrize("prior", [*WNOA, *WNOJ], ids=lambda prior: prior.__name__)


def qc_of(prior: Any, whole: bool = False) -> Array:
    rng = np.random.default_rng(1)
    S = rng.normal(size=(SIZES[prior], SIZES[prior]))
    return S @ S.T + np.eye(SIZES[prior]) if whole else rng.uniform(0.01, 0.1, SIZES[prior])


def order_of(prior: Any) -> int:
    return 2 if prior in WNOA else 3


def keys_of(prior: Any, k: int) -> list[int]:
    return [X(k), V(k), A(k)][: order_of(prior)]


def space_of(prior: Any) -> str:
    """Name of the poses in GTSAM."""
    return prior.__name__[len("WnoaPriorFactor") :] or "Pose3"


def pose_of(prior: Any, rng: np.random.Generator) -> Any:
    made: dict[str, Any] = {
        "Pose3": lambda: gtsam.Pose3(se3_exp(rng.normal(size=6))),
        "Pose2": lambda: gtsam.Pose2(*rng.normal(size=3)),
        "Rot3": lambda: gtsam.Rot3.Expmap(rng.normal(size=3)),
        "Vector": lambda: rng.normal(size=4),
    }
    return made[space_of(prior)]()


def moved(pose: Any, step: Array) -> Any:
    """The pose at the end of a step in the tangent, by the group's own exponential."""
    if isinstance(pose, np.ndarray):
        return pose + step
    return pose.compose(type(pose).Expmap(step))


def states(prior: Any, seed: int, dt: float, count: int = 2) -> gtsam.Values:
    """States dt apart that move at about 1 per second, and their rates."""
    rng, values, size = np.random.default_rng(seed), gtsam.Values(), SIZES[prior]
    pose = pose_of(prior, rng)
    for k in range(count):
        rates = rng.normal(size=(order_of(prior) - 1, size))
        for key, value in zip(keys_of(prior, k), (pose, *rates), strict=True):
            values.insert(key, value)
        pose = moved(pose, dt * (rates[0] + rng.normal(size=size)))
    return values


def make(prior: Any, dt: float, whole: bool = False) -> Any:
    return prior(*keys_of(prior, 0), *keys_of(prior, 1), dt, qc_of(prior, whole))


def read(prior: Any, values: gtsam.Values, k: int) -> list[Any]:
    pose = getattr(values, f"at{space_of(prior)}")(X(k))
    return [pose, *(values.atVector(key) for key in keys_of(prior, k)[1:])]


@each_prior
@pytest.mark.parametrize("dt", [1e-3, 0.1, 0.5])
@pytest.mark.parametrize("whole", [False, True])
def test_jacobians_are_the_derivatives(prior: Any, dt: float, whole: bool) -> None:
    for seed in range(3):
        factor = make(prior, dt, whole)
        assert_derivatives_match(factor, states(prior, seed, dt), tolerance=1e-9)


@pytest.mark.parametrize(
    ("prior", "native"),
    [
        (WnoaPriorFactor, gtsam.WnoaMotionFactorPose3),
        (WnoaPriorFactorPose2, gtsam.WnoaMotionFactorPose2),
    ],
)
def test_errors_are_gtsams(prior: Any, native: Any) -> None:
    dt, values = 0.3, states(prior, 4, 0.3)
    data = [gtsam.StateData(X(k), V(k), k * dt) for k in range(2)]
    ours, theirs = prior(*data, qc_of(prior)), native(*data, qc_of(prior))
    np.testing.assert_allclose(ours.error(values), theirs.error(values), rtol=1e-9)


@pytest.mark.parametrize("dt", [1e-3, 0.1, 0.5])
def test_white_noise_about_an_acceleration(dt: float) -> None:
    """Local variables that move at it have no error, and the derivatives are those about zero."""
    rng = np.random.default_rng(7)
    start, (v, a) = se3_exp(rng.normal(size=6)), rng.normal(size=(2, 6))
    xi = dt * v + 0.5 * dt**2 * a
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3(start))
    values.insert(V(0), v)
    values.insert(X(1), gtsam.Pose3(start @ se3_exp(xi)))
    values.insert(V(1), se3_right_jacobian(xi) @ (v + dt * a))
    made_of = X(0), V(0), X(1), V(1), dt, qc_of(WnoaPriorFactor, True)
    about_mean, about_zero = WnoaPriorFactor(*made_of, acceleration=a), WnoaPriorFactor(*made_of)
    scale = np.abs(about_zero.unwhitenedError(values)).max()
    assert np.abs(about_mean.unwhitenedError(values)).max() < 1e-9 * scale
    with_mean, without = (f.linearize(values).jacobian()[0] for f in (about_mean, about_zero))
    np.testing.assert_array_equal(with_mean, without)
    assert about_mean.equals(from_dict(to_dict(graph_of(about_mean))).at(0))
    assert not about_mean.equals(about_zero)
    with pytest.raises(ValueError, match=r"acceleration must"):
        WnoaPriorFactor(*made_of, acceleration=a[:5])


@each_prior
def test_errors_of_vectors_of_one_axis_agree(prior: Any) -> None:
    """Motion along one axis of a group is motion of a number."""
    size, order, dt = SIZES[prior], order_of(prior), 0.2
    kind, rng = [WnoaPriorFactorVector, WnojPriorFactorVector][order - 2], np.random.default_rng(0)
    numbers = rng.normal(size=(2, order)) * 0.5
    values, lines, axis = gtsam.Values(), gtsam.Values(), np.eye(size)[size - 1]
    pose = pose_of(prior, rng)
    for k in range(2):
        along = [moved(pose, numbers[k, 0] * axis), *(x * axis for x in numbers[k, 1:])]
        for key, value, number in zip(keys_of(prior, k), along, numbers[k], strict=True):
            values.insert(key, value)
            lines.insert(key, np.array([number]))
    qc = qc_of(prior)
    line = kind(*keys_of(kind, 0), *keys_of(kind, 1), dt, qc[size - 1 :])
    np.testing.assert_allclose(make(prior, dt).error(values), line.error(lines), rtol=1e-10)


@pytest.mark.parametrize("turn", [1e-3, 1e-4, 1e-5, 1e-7, 1e-9])
def test_small_turns_of_pose2_by_their_power_series(turn: float) -> None:
    """Where the formulas of SE(2) divide by the turn, and GTSAM is wrong by up to 0.03."""
    keys, dt, values = [X(0), V(0), X(1), V(1)], 0.1, gtsam.Values()
    x, y, v_i, v_j = 1.3, -0.7, np.array([0.3, 1.1, -0.8]), np.array([-0.4, 0.9, 1.7])
    for key, value in zip(keys, (gtsam.Pose2(), v_i, gtsam.Pose2(x, y, turn), v_j), strict=True):
        values.insert(key, value)
    a, b = 1 - turn**2 / 12, turn / 2
    xi = np.array([a * x + b * y, a * y - b * x, turn])
    ad = np.array([[0, -turn, xi[1]], [turn, 0, -xi[0]], [0, 0, 0]])
    w = v_j + ad @ v_j / 2 + ad @ ad @ v_j / 12 - ad @ ad @ ad @ ad @ v_j / 720
    expected = np.r_[xi - dt * v_i, w - v_i]
    S = prior_square_root_information(2, dt, np.ones(3), 3)
    found = np.linalg.solve(S, WnoaPriorFactorPose2(*keys, dt, np.ones(3)).unwhitenedError(values))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
@pytest.mark.parametrize("dt", [1e-6, 0.2])
def test_vectors_of_any_size_by_hand(size: int, dt: float) -> None:
    """Those of points are read by GTSAM, but its noise is of short durations and whole qc, too."""
    rng, values, keys = np.random.default_rng(size), gtsam.Values(), [X(0), V(0), X(1), V(1)]
    x_i, v_i, x_j, v_j = numbers = rng.normal(size=(4, size))
    for key, number in zip(keys, numbers, strict=True):
        values.insert(key, number)
    A = rng.normal(size=(size, size))
    qc = A @ A.T + np.eye(size)
    linear = WnoaPriorFactorVector(*keys, dt, qc).linearize(values)
    S, one = prior_square_root_information(2, dt, qc, size), np.eye(size)
    error = np.r_[x_j - x_i - dt * v_i, v_j - v_i]
    J = np.block([[-one, -dt * one, one, 0 * one], [0 * one, -one, 0 * one, one]])
    expected, found = (M.T @ M for M in (S @ np.c_[J, -error], linear.augmentedJacobian()))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-13)


def decimals(array: Any) -> Any:
    return np.vectorize(Decimal, otypes=[object])(np.asarray(array, np.float64))


def exp_decimals(xi: Any) -> Any:
    """(4, 4) exponential of a twist by its power series, to 60 digits."""
    w, v = xi[:3], xi[3:]
    hat = decimals(np.zeros((4, 4)))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        hat[k, j], hat[j, k], hat[i, 3] = w[i], -w[i], v[i]
    total = power = decimals(np.eye(4))
    for n in range(1, 70):
        power = power.dot(hat) / n
        total = total + power
    return total


def state_of_definition(xi: Array, w: Array, u: Array) -> tuple[Array, Array, Array]:
    """Pose, twist and acceleration at t = 0 of the motion Exp(xi + w t + u t^2 / 2), to 60 digits.

    From the definition: the twist is (T^-1 dT/dt) without its hat, by differences of 1e-15 s.
    """
    with localcontext() as context:
        context.prec = 60
        path, h = [decimals(part) for part in (xi, w, u)], Decimal("1e-12")

        def pose(t: Decimal) -> Any:
            return exp_decimals(path[0] + path[1] * t + path[2] * t * t / 2)

        def twist(t: Decimal) -> Any:
            T, rate = pose(t), (pose(t + h) - pose(t - h)) / (2 * h)
            R = T[:3, :3].T
            spin, speed = R.dot(rate[:3, :3]), R.dot(rate[:3, 3])
            return np.array([spin[2, 1], spin[0, 2], spin[1, 0], *speed])

        zero = Decimal(0)
        acceleration = (twist(h) - twist(-h)) / (2 * h)
        found = pose(zero), twist(zero), acceleration
        return tuple(part.astype(np.float64) for part in found)  # type: ignore[return-value]


@pytest.mark.parametrize("angle", [1e-6, 0.1, 1.0, 2.5, 3.1])
def test_local_variables_are_those_of_the_definition_to_60_digits(angle: float) -> None:
    """And back; the error of the jerk prior is linear in them."""
    rng = np.random.default_rng(int(10 * angle))
    xi, w, u = rng.normal(size=(3, 6))
    xi[:3] *= angle / np.linalg.norm(xi[:3])
    T, v, a = state_of_definition(xi, w, u)
    local = local_motion_kernel(np.eye(4), T, v, a)[:, 24]
    expected = np.concatenate([xi, w, u])
    np.testing.assert_allclose(local, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    back = np.empty((4, 4)), np.empty(6), np.empty(6)
    retract_motion_kernel(np.eye(4), expected, *back)
    for found, exact in zip(back, (T, v, a), strict=True):
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * max(1, np.abs(exact).max()))
    v_i, a_i, dt = *rng.normal(size=(2, 6)), 0.37
    error = wnoj_kernel(np.eye(4), v_i, a_i, T, v, a, dt)[:, 36]
    by_hand = np.r_[xi - dt * v_i - dt**2 / 2 * a_i, w - v_i - dt * a_i, u - a_i]
    np.testing.assert_allclose(error, by_hand, atol=1e-12 * np.abs(expected).max())


@each_prior
@pytest.mark.parametrize("dt", [1e-6, 1e-3, 0.3])
def test_covariance_and_its_root(prior: Any, dt: float) -> None:
    """Against the integral of the process, in fractions; without units at one tolerance."""
    size, order = SIZES[prior], order_of(prior)
    qc = qc_of(prior, whole=True)
    powers = [2 * order - 1 - i - j for i in range(order) for j in range(order)]
    factorials = np.array([1, 1, 2])
    scalars = np.array(
        [
            dt**n / (factorials[order - 1 - i] * factorials[order - 1 - j] * n)
            for n, (i, j) in zip(powers, np.ndindex(order, order), strict=True)
        ]
    ).reshape(order, order)
    expected = np.kron(scalars, qc)
    sigmas = np.sqrt(np.diag(expected))
    found = prior_covariance(order, dt, qc, size)
    scale = np.outer(sigmas, sigmas)
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-12)
    S = prior_square_root_information(order, dt, qc, size) * sigmas
    identity = S @ (expected / scale) @ S.T
    np.testing.assert_allclose(identity, np.eye(order * size), atol=1e-10)


@each_prior
def test_a_diagonal_of_q_c_is_the_same_as_the_whole_matrix(prior: Any) -> None:
    given, size = qc_of(prior) * np.logspace(-6, 6, SIZES[prior]), SIZES[prior]
    for of in (prior_covariance, prior_square_root_information):
        each, whole = (of(order_of(prior), 0.02, qc, size) for qc in (given, np.diag(given)))
        np.testing.assert_allclose(each, whole, rtol=1e-15, atol=0)


@each_prior
@pytest.mark.parametrize("dt", [1e-6, 0.3])
def test_interpolation_is_between_its_states_and_without_error(prior: Any, dt: float) -> None:
    """At the states it is the states; a motion without noise is interpolated to itself."""
    values, factor = states(prior, 3, dt), make(prior, dt)
    for t, k in ((0.0, 0), (dt, 1)):
        for found, expected in zip(
            factor.interpolate(values, t), read(prior, values, k), strict=True
        ):
            same(found, expected, 1e-9 if k and dt < 1e-3 else 1e-12)
    order, rng = order_of(prior), np.random.default_rng(0)
    start = [pose_of(prior, rng), *rng.normal(size=(order - 1, SIZES[prior]))]
    if prior is WnojPriorFactor:
        return  # at constant local jerk the end is only known in local variables: the next test
    if order == 2:  # constant twist
        after = [[moved(start[0], t * start[1]), start[1]] for t in (dt / 3, dt)]
        both = gtsam.Values()
        for k, state in enumerate((start, after[1])):
            for key, value in zip(keys_of(prior, k), state, strict=True):
                both.insert(key, value)
        assert factor.error(both) < 1e-12 / dt**3 * 1e-12
        for found, expected in zip(factor.interpolate(both, dt / 3), after[0], strict=True):
            same(found, expected, 1e-12 if dt > 1e-3 else 1e-9)  # rates are differences over dt


def same(found: Any, expected: Any, tolerance: float) -> None:
    if isinstance(found, np.ndarray):
        scale = max(1.0, float(np.abs(expected).max()))
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * scale)
    else:
        assert found.equals(expected, tolerance)


@pytest.mark.parametrize("share", [0.2, 0.7])
def test_interpolated_jerk_follows_the_quintic_of_its_local_variables(share: float) -> None:
    """The state between, from the definition to 60 digits at the local variables of a quintic."""
    rng, dt = np.random.default_rng(5), 0.4
    coefficients = rng.normal(size=(6, 6)) / np.array([1, 1, 2, 6, 24, 120])[:, None]
    coefficients[0] = 0

    def path(t: float) -> tuple[Array, Array, Array]:
        polynomials = [np.polynomial.Polynomial(c) for c in coefficients.T]
        return tuple(np.array([p.deriv(n)(t) for p in polynomials]) for n in range(3))  # type: ignore[return-value]

    values, T_i = gtsam.Values(), se3_exp(rng.normal(size=6))
    for k, t in enumerate((0.0, dt)):
        T, v, a = state_of_definition(*path(t))
        values.insert(X(k), gtsam.Pose3(T_i @ T))
        values.insert(V(k), v)
        values.insert(A(k), a)
    found = make(WnojPriorFactor, dt).interpolate(values, share * dt)
    T, v, a = state_of_definition(*path(share * dt))
    np.testing.assert_allclose(found[0].matrix(), T_i @ T, atol=1e-12)
    np.testing.assert_allclose(found[1], v, atol=1e-11)
    np.testing.assert_allclose(found[2], a, atol=1e-9)


def test_wnoa_in_space_interpolates_as_the_function_does() -> None:
    dt, values = 0.2, states(WnoaPriorFactor, 2, 0.2)
    (T_i, v_i), (T_j, v_j) = (read(WnoaPriorFactor, values, k) for k in range(2))
    S = np.random.default_rng(0).normal(size=(24, 24))
    joint, qc = S @ S.T, qc_of(WnoaPriorFactor)
    expected = interpolate(T_i, v_i, T_j, v_j, 0.0, dt, 0.07, qc, joint)
    factor = make(WnoaPriorFactor, dt)
    pose, velocity = factor.interpolate(values, 0.07)
    np.testing.assert_allclose(pose.matrix(), expected.pose, atol=1e-13)
    np.testing.assert_allclose(velocity, expected.velocity, atol=1e-13)
    assert expected.covariance is not None
    found = factor.covariance(values, 0.07, joint)
    np.testing.assert_allclose(found, expected.covariance, rtol=1e-9, atol=1e-12)


def with_state_between(prior: Any, dt: float) -> tuple[gtsam.Values, Any, Array]:
    """Two states and one between, the prior of the former, and both steps' (2 n, 3 n) Jacobian."""
    values, factor = states(prior, 6, dt), make(prior, dt)
    n, t = order_of(prior) * SIZES[prior], 0.3 * dt
    for key, value in zip(keys_of(prior, 2), factor.interpolate(values, t), strict=True):
        values.insert(key, value)
    J = np.zeros((2 * n, 3 * n))
    for k, (i, j, step) in enumerate(((0, 2, t), (2, 1, dt - t))):
        prior_of_step = prior(*keys_of(prior, i), *keys_of(prior, j), step, qc_of(prior))
        whitened = prior_of_step.linearize(values).jacobian()[0]
        for end, part in ((i, whitened[:, :n]), (j, whitened[:, n:])):
            J[k * n : (k + 1) * n, end * n : (end + 1) * n] = part
    return values, factor, J


def assert_same_covariance(found: Array, expected: Array) -> None:
    sigmas = np.sqrt(np.diag(expected))
    scale = np.outer(sigmas, sigmas)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-9)


@each_prior
@pytest.mark.parametrize("dt", [1e-6, 1e-3, 0.1])
def test_covariance_between_known_states_to_60_digits(prior: Any, dt: float) -> None:
    values, factor, J = with_state_between(prior, dt)
    n = order_of(prior) * SIZES[prior]
    found = factor.covariance(values, 0.3 * dt, np.zeros((2 * n, 2 * n)))
    assert_same_covariance(found, inverse_information(J[:, 2 * n :]))


@each_prior
def test_covariance_between_is_that_of_a_state_put_in_to_60_digits(prior: Any) -> None:
    values, factor, J = with_state_between(prior, 0.1)
    n = order_of(prior) * SIZES[prior]
    others = np.hstack([np.diag(np.full(2 * n, 10.0)), np.zeros((2 * n, n))])
    whole = inverse_information(np.vstack([others, J]))
    found = factor.covariance(values, 0.03, whole[: 2 * n, : 2 * n])
    assert_same_covariance(found, whole[2 * n :, 2 * n :])
    np.testing.assert_array_equal(
        factor.covariance(values, 0.0, whole[: 2 * n, : 2 * n]), whole[:n, :n]
    )


@each_prior
def test_a_chain_finds_the_motion(prior: Any) -> None:
    """Poses measured exactly; the rates come out near the true ones."""
    rng, dt, size = np.random.default_rng(0), 0.05, SIZES[prior]
    rate, start = rng.normal(size=size) * 0.5, pose_of(prior, rng)
    graph, values, order = gtsam.NonlinearFactorGraph(), gtsam.Values(), order_of(prior)
    measured = getattr(gtsam, f"PriorFactor{space_of(prior)}")
    noise = gtsam.noiseModel.Isotropic.Sigma(size, 1e-4)
    for k in range(8):
        pose = moved(start, k * dt * rate)
        graph.add(measured(X(k), pose, noise))
        values.insert(X(k), pose)
        for key in keys_of(prior, k)[1:]:
            values.insert(key, np.zeros(size))
    for i, j in pairwise(range(8)):
        graph.add(prior(*keys_of(prior, i), *keys_of(prior, j), dt, qc_of(prior)))
    solved = optimize(graph, values)
    for k in range(8):
        np.testing.assert_allclose(solved.atVector(V(k)), rate, atol=0.02)
        if order == 3:
            np.testing.assert_allclose(solved.atVector(A(k)), 0, atol=0.05)


@each_prior
def test_manners_are_those_of_all_factors(prior: Any) -> None:
    factor, dt = make(prior, 0.1), 0.1
    size, order = SIZES[prior], order_of(prior)
    assert repr(factor).startswith(f"{prior.__name__}(x0, v0")
    assert pickle.loads(pickle.dumps(factor)).equals(factor)
    assert not factor.equals(make(prior, 0.2))
    by_states = prior(*((*keys_of(prior, k), k * dt) for k in range(2)), qc_of(prior))
    assert by_states.equals(factor)
    assert factor.equals(from_dict(to_dict(graph_of(factor))).at(0))
    values = states(prior, 0, dt)
    values.erase(V(1))
    values.insert(V(1), np.zeros(size + 1))
    with pytest.raises(ValueError, match=rf"v1 .velocity_j. must be a vector of {size}"):
        factor.linearize(values)
    doubled = [*keys_of(prior, 0), *keys_of(prior, 1)]
    doubled[order] = X(0)
    for fault, call in (
        ("dt", lambda: prior(*keys_of(prior, 0), *keys_of(prior, 1), 0.0, qc_of(prior))),
        ("qc", lambda: prior(*keys_of(prior, 0), *keys_of(prior, 1), dt, -qc_of(prior))),
        ("must not be the key of", lambda: prior(*doubled, dt, qc_of(prior))),
        ("state_i", lambda: prior((X(0), 0.0), (X(1), 0.1), qc_of(prior))),
        ("t must be within", lambda: factor.interpolate(values, 0.2)),
    ):
        with pytest.raises(ValueError, match=fault):
            call()


def test_derivative_helper_sees_all_variables() -> None:
    """The numerical derivative is by every column of a vector of any size."""
    values = gtsam.Values()
    values.insert(X(0), np.zeros(4))
    found = derivative(lambda v: v.atVector(X(0)) * 2, values, X(0), 1e-3)
    np.testing.assert_allclose(found, 2 * np.eye(4), atol=1e-12)


def test_a_density_seen_from_another_frame_is_as_good() -> None:
    """A D Aᵀ is symmetric but for rounding."""
    A = se3_adjoint(se3_exp(np.array([0.3, -0.8, 0.5, 1.0, 2.0, -0.5])))
    qc = A @ np.diag([0.1, 0.1, 0.1, 0.5, 0.5, 0.5]) @ A.T
    qc[0, 3] += 1e-16
    assert (qc != qc.T).any()
    covariance = wnoa_covariance(0.1, qc)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert WnoaPriorFactor(X(0), V(0), X(1), V(1), 0.1, qc).dim() == 12


@pytest.mark.parametrize("wrong", [-np.eye(24), np.eye(24) + np.diag(np.ones(23), 1)])
def test_what_is_no_covariance_is_refused(wrong: Array) -> None:
    factor, values = WnoaPriorFactor(X(0), V(0), X(1), V(1), 0.1, np.ones(6)), gtsam.Values()
    for k in range(2):
        values.insert(X(k), gtsam.Pose3())
        values.insert(V(k), np.zeros(6))
    with pytest.raises(ValueError, match="joint_covariance must be a covariance"):
        factor.covariance(values, 0.05, wrong)
