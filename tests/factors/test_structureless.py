"""All landmarks in one factor without them: what it tells of the states is what they tell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC, derivative, random_states, seeds, state
from gtsam.symbol_shorthand import L, V, X
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import (
    InterpolatedStereoFactor,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    gauss_newton_parameters,
    interpolate,
    optimize,
)
from factors.lie import se3_adjoint, se3_exp, se3_inverse
from factors.structureless.joint_system import root_kernel

Array = NDArray[np.float64]
Measured = tuple[Array, Array, NDArray[np.int64]]

examples = settings(deadline=None, max_examples=10)
DT, COUNT = 0.05, 3
STATES = [(X(k), V(k), k * DT) for k in range(COUNT)]
KEYS = [key for x, v, _ in STATES for key in (x, v)]
ESTIMATORS = gtsam.noiseModel.mEstimator
HUBER = gtsam.noiseModel.Robust.Create(ESTIMATORS.Huber.Create(0.5), NOISE)
CAUCHY = gtsam.noiseModel.Robust.Create(ESTIMATORS.Cauchy.Create(1.5), NOISE)
FAIR = gtsam.noiseModel.Robust.Create(ESTIMATORS.Fair.Create(1.0), NOISE)
MODELS = pytest.mark.parametrize(
    "model", [NOISE, HUBER, CAUCHY, FAIR], ids=["gaussian", "huber", "cauchy", "fair"]
)


def scene(seed: int, seen: int = 6) -> tuple[gtsam.Values, Measured]:
    """Three states, and measurements at random times and in random order of five landmarks."""
    values, rng = random_states(seed, DT, COUNT), np.random.default_rng(seed)
    values.erase(L(0))
    number = rng.permutation(np.repeat([7, -3, 2**40, 0, 11], seen))
    times = rng.uniform(0, DT * (COUNT - 1), len(number))
    points = np.c_[rng.uniform(-1, 1, (5, 2)), rng.uniform(2, 6, 5), np.ones(5)]
    in_world = (state(values, 0)[0] @ points.T).T[np.unique(number, return_inverse=True)[1]]
    seen_from = np.einsum("nij,nj->ni", se3_inverse(poses(values, times)), in_world)
    measured = CAMERA.project(seen_from[:, :3]) + rng.normal(size=(len(number), 3)) * [1, 1, 0.3]
    return values, (measured, times, number)


def poses(values: gtsam.Values, times: Array) -> Array:
    """(n, 4, 4) poses between the states at the times (n,)."""
    i = np.clip((times / DT).astype(int), 0, COUNT - 2)
    T, v = (np.array(part) for part in zip(*(state(values, k) for k in range(COUNT)), strict=True))
    return interpolate(T[i], v[i], T[i + 1], v[i + 1], i * DT, (i + 1) * DT, times).pose


def structureless(data: Measured, model: Any = NOISE) -> StructurelessStereoFactor:
    return StructurelessStereoFactor(*data, model, STATES, CAMERA)


def one_by_one(data: Measured, model: Any = NOISE) -> list[StructurelessStereoFactor]:
    """One factor for each landmark, in order of the landmarks."""
    measured, times, number = data
    factors = []
    for n in np.unique(number).tolist():
        rows = number == n
        factors.append(
            StructurelessStereoFactor(measured[rows], times[rows], n, model, STATES, CAMERA)
        )
    return factors


def explicit(data: Measured, model: Any = NOISE) -> list[gtsam.CustomFactor]:
    """A factor for each measurement; landmark k in increasing order is L(k)."""
    measured, times, number = data
    points = np.unique(number, return_inverse=True)[1]
    factors = []
    for stereo, t, point in zip(measured, times, points.tolist(), strict=True):
        k = min(int(t / DT), COUNT - 2)
        keys = X(k), V(k), X(k + 1), V(k + 1), L(point)
        interval = k * DT, (k + 1) * DT, t
        factors.append(InterpolatedStereoFactor(stereo, model, *keys, CAMERA, *interval))
    return factors


def graph_of(factors: list[Any]) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    return graph


def information(
    factors: list[Any], values: gtsam.Values, keys: list[int] = KEYS
) -> tuple[Array, Array]:
    """Hessian and gradient of half the squared error by the states."""
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    H, minus_gradient = graph_of(factors).linearize(values).hessian(ordering)
    return H, -minus_gradient


def with_landmarks(values: gtsam.Values, points: Array) -> gtsam.Values:
    both = gtsam.Values(values)
    for k, point in enumerate(points):
        both.insert(L(k), point)
    return both


def assert_same(found: Array, expected: Array, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@MODELS
@given(seed=seeds)
@examples
def test_it_tells_what_factors_of_one_landmark_each_tell(model: Any, seed: int) -> None:
    values, data = scene(seed)
    one, many = structureless(data, model), one_by_one(data, model)
    number, points = one.landmarks(values)
    alone = [each.landmarks(values) for each in many]
    np.testing.assert_array_equal(np.concatenate([found[0] for found in alone]), number)
    apart = np.linalg.norm(np.concatenate([found[1] for found in alone]) - points, axis=1)
    assert (apart <= 1e-9 * np.linalg.norm(points, axis=1)).all()
    np.testing.assert_allclose(one.error(values), graph_of(many).error(values), rtol=1e-7)
    (H, gradient), (H_alone, alone_gradient) = (
        information(factors, values) for factors in ([one], many)
    )
    assert_same(H, H_alone, 1e-5 if model is not NOISE else 1e-7)
    # A factor of one landmark is singular. The pivots that its root leaves out are rounding errors,
    # and the gradient along a pivot p of H is at most the root of p times that of twice the cost.
    largest = np.sqrt(np.diag(H) * 2 * one.error(values))
    least_pivot = 1e-12
    bound = (1e-5 if model is not NOISE else np.sqrt(least_pivot)) * largest.max()
    assert np.abs(gradient - alone_gradient).max() <= bound


@MODELS
@given(seed=seeds)
@examples
def test_it_tells_what_is_left_of_dense_jacobians_without_the_landmarks(
    model: Any, seed: int
) -> None:
    """Projected onto the null space of the landmarks' derivatives."""
    values, data = scene(seed)
    one = structureless(data, model)
    number, points = one.landmarks(values)
    linear = graph_of(explicit(data, model)).linearize(with_landmarks(values, points))
    ordering = gtsam.Ordering()
    for key in [*KEYS, *(L(k) for k in range(len(number)))]:
        ordering.push_back(key)
    jacobian, minus_error = linear.jacobian(ordering)
    by_states, by_landmarks = np.split(jacobian, [6 * len(KEYS)], axis=1)
    Q = np.linalg.qr(by_landmarks)[0]
    left = by_states - Q @ (Q.T @ by_states)
    H, gradient = information([one], values)
    assert_same(H, left.T @ left)
    noise = 1e-9 * np.linalg.norm(left, axis=0) * np.linalg.norm(minus_error)
    assert np.all(np.abs(gradient + left.T @ minus_error) <= noise)


@MODELS
@given(seed=seeds)
@examples
def test_it_costs_what_its_measurements_cost(model: Any, seed: int) -> None:
    values, data = scene(seed)
    one = structureless(data, model)
    both = with_landmarks(values, one.landmarks(values)[1])
    np.testing.assert_allclose(
        one.error(values), graph_of(explicit(data, model)).error(both), rtol=1e-9
    )


@MODELS
@given(seed=seeds)
@examples
def test_gradient(model: Any, seed: int) -> None:
    """The landmarks are where they fit best, so their motion with the states does not count."""
    values, data = scene(seed)
    factor = structureless(data, model)
    numerical = np.concatenate([derivative(factor.error, values, key, 1e-6) for key in KEYS])
    assert_same(information([factor], values)[1], numerical, 1e-5)


@MODELS
@pytest.mark.parametrize("seed", range(3))
def test_landmarks_are_where_gtsam_puts_them(model: Any, seed: int) -> None:
    """With the poses held."""
    values, data = scene(seed)
    measured, times, number = data
    found, points = structureless(data, model).landmarks(values)
    np.testing.assert_array_equal(found, np.unique(number))
    graph, start = gtsam.NonlinearFactorGraph(), with_landmarks(gtsam.Values(), points + 0.01)
    of_point = np.searchsorted(found, number).tolist()
    for n, T in enumerate(poses(values, times)):
        start.insert(X(n), gtsam.Pose3(T))
        graph.add(gtsam.NonlinearEqualityPose3(X(n), gtsam.Pose3(T)))
        graph.add(StereoReprojectionFactor(measured[n], model, X(n), L(of_point[n]), CAMERA))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    parameters.setMaxIterations(500)
    solved = gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize()
    gtsams = np.array([solved.atPoint3(L(k)) for k in range(len(found))])
    np.testing.assert_allclose(points, gtsams, rtol=0, atol=2e-5)


@MODELS
def test_a_graph_has_the_optimum_of_one_with_landmarks(model: Any) -> None:
    truth, data = scene(1)
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    chain = [gtsam.PriorFactorPose3(X(0), truth.atPose3(X(0)), tight)]
    chain += [gtsam.PriorFactorVector(V(0), truth.atVector(V(0)), tight)]
    qc = 1e3 * QC  # the states accelerate by chance
    chain += [WnoaPriorFactor(*KEYS[2 * k : 2 * k + 4], DT, qc) for k in range(COUNT - 1)]
    start = gtsam.Values(truth)
    start.update(X(2), truth.atPose3(X(2)).retract(np.full(6, 0.02)))
    one = structureless(data, model)
    without = solved([*chain, one], start)
    near = gtsam.Values(without)
    near.update(X(2), without.atPose3(X(2)).retract(np.full(6, 1e-3)))
    near = with_landmarks(near, one.landmarks(near)[1] + 1e-3)
    both = solved([*chain, *explicit(data, model)], near)
    assert graph_of([*chain, one]).error(without) < graph_of([*chain, one]).error(start)
    for k in range(COUNT):
        assert without.atPose3(X(k)).equals(both.atPose3(X(k)), 1e-6)
        np.testing.assert_allclose(without.atVector(V(k)), both.atVector(V(k)), atol=1e-5)
    points = np.array([both.atPoint3(L(k)) for k in range(5)])
    np.testing.assert_allclose(one.landmarks(without)[1], points, atol=1e-5)


def solved(factors: list[Any], start: gtsam.Values) -> gtsam.Values:
    return optimize(graph_of(factors), start, gauss_newton_parameters(300, 1e-15))


@MODELS
@given(seed=seeds)
@examples
def test_the_order_of_the_measurements_does_not_matter(model: Any, seed: int) -> None:
    values, data = scene(seed)
    order = np.random.default_rng(seed).permutation(len(data[1]))
    measured, times, number = (part[order] for part in data)
    A, b = structureless(data, model).linearize(values).jacobian()
    A_other, b_other = structureless((measured, times, number), model).linearize(values).jacobian()
    np.testing.assert_array_equal(A_other, A)
    np.testing.assert_array_equal(b_other, b)


@given(seeds)
@examples
def test_the_world_frame_does_not_matter(seed: int) -> None:
    values, data = scene(seed)
    S = se3_exp(np.random.default_rng(seed).normal(size=6) * 3)
    moved = gtsam.Values(values)
    for k in range(COUNT):
        moved.update(X(k), gtsam.Pose3(S @ state(values, k)[0]))
    factor = structureless(data)
    np.testing.assert_allclose(factor.error(moved), factor.error(values), rtol=1e-9)
    for found, same in zip(
        information([factor], moved), information([factor], values), strict=True
    ):
        assert_same(found, same)
    points = factor.landmarks(values)[1]
    np.testing.assert_allclose(
        factor.landmarks(moved)[1], points @ S[:3, :3].T + S[:3, 3], rtol=0, atol=1e-7
    )


@given(seeds)
@examples
def test_it_tells_nothing_of_the_world_frame(seed: int) -> None:
    """The six directions of the gauge, and no other."""
    values, data = scene(seed, seen=10)
    H, gradient = information([structureless(data)], values)
    gauge = np.zeros((6 * len(KEYS), 6))
    for k in range(COUNT):
        gauge[12 * k : 12 * k + 6] = se3_adjoint(se3_inverse(state(values, k)[0]))
    scale = np.sqrt(np.diag(H))
    assert np.abs(H @ gauge / scale[:, None]).max() < 1e-8 * scale.max()
    assert np.abs(gauge.T @ gradient).max() < 1e-7 * scale.max()
    eigenvalues = np.linalg.eigvalsh(H / np.outer(scale, scale))
    assert eigenvalues[5] < 1e-12
    assert eigenvalues[6] > 1e-10


@given(seeds, st.integers(0, 9), st.floats(-4, 4))
@example(seed=1329765, rank=8, decades=0.0)  # its last pivot is 1e-10
@examples
def test_root_of_singular_information(seed: int, rank: int, decades: float) -> None:
    """Whatever the rank, and the units of the columns."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(rank, 9)) * 10 ** (decades * rng.uniform(size=9))
    H = J.T @ J
    scale = np.sqrt(np.diag(H))
    R = root_kernel(np.triu(H), scale)
    assert np.all(np.abs(R.T @ R - H) <= 1e-11 * np.outer(scale, scale))
    assert np.count_nonzero(np.abs(R).max(axis=1)) <= rank + 1


@given(seeds)
@examples
def test_a_landmark_measured_once_tells_nothing(seed: int) -> None:
    values, (measured, times, number) = scene(seed)
    more = np.r_[measured, [[100.0, 120.0, 3.0]]], np.r_[times, 0.06], np.r_[number, 99]
    factors = structureless((measured, times, number)), structureless(more)
    np.testing.assert_allclose(factors[1].error(values), factors[0].error(values), rtol=1e-9)
    expected, found = (information([factor], values) for factor in factors)
    assert_same(found[0], expected[0], 1e-10)
    assert_same(found[1], expected[1], 1e-8)


@pytest.mark.parametrize("disparity", [1e-6, 1e-3])
@given(seed=seeds)
@examples
def test_a_landmark_at_infinity_tells_the_rotation(disparity: float, seed: int) -> None:
    values, (measured, times, number) = scene(seed)
    far = number == 7
    T = poses(values, times[far])
    direction = T[0, :3, :3] @ [0.1, -0.2, 1.0]
    seen = direction @ T[:, :3, :3]
    measured[far, :2] = (226 * seen / seen[:, 2:])[:, :2] + [173, 130]
    measured[far, :2] += np.random.default_rng(seed).normal(size=(far.sum(), 2))
    measured[far, 2] = disparity
    data = measured[far], times[far], number[far]
    factor = structureless(data)
    keys = [KEYS[n] for n in range(len(KEYS)) if KEYS[n] in set(factor.keys())]
    H, gradient = information([factor], values, keys)
    numerical = np.concatenate([derivative(factor.error, values, key, 1e-4) for key in keys])
    assert_same(gradient, numerical, 1e-5)
    assert np.diag(H)[:3].max() > 0
    assert np.isfinite(factor.landmarks(values)[1]).all()


def test_nothing_is_special_a_little_beyond_infinity() -> None:
    """Rays that diverge: the camera moves to the right, and the landmark in its image too."""
    values = gtsam.Values()
    for k in range(COUNT):
        values.insert(X(k), gtsam.Pose3(gtsam.Rot3(), np.array([0.1 * k, 0.0, 0.0])))
        values.insert(V(k), np.array([0, 0, 0, 0.1 / DT, 0, 0]))
    times = np.linspace(0, 2 * DT, 7)
    measured = np.c_[173 + 40 * times, np.full(7, 130.0), np.full(7, 1e-6)]
    factor = structureless((measured, times, np.zeros(7, int)))
    assert factor.landmarks(values)[1][0, 2] < -10
    numerical = np.concatenate([derivative(factor.error, values, key, 1e-4) for key in KEYS])
    assert_same(information([factor], values)[1], numerical, 1e-6)
    errors, depths = [], []
    for angle in np.linspace(0.0, -0.06, 9):  # turned until the rays converge
        for k in range(COUNT):
            turned = gtsam.Rot3.Ry(angle * k / 2)
            values.update(X(k), gtsam.Pose3(turned, np.array([0.1 * k, 0.0, 0.0])))
        errors.append(factor.error(values))
        depths.append(factor.landmarks(values)[1][0, 2])
    assert depths[2] < -100
    assert depths[3] > 50
    curvatures = np.diff(errors, 2)
    np.testing.assert_allclose(curvatures, curvatures.mean(), rtol=0.1)  # as smooth as a parabola


def test_behind_a_camera_the_error_is_large_and_constant() -> None:
    """Half a turn between two measurements: one of them fits, the other is GTSAM's constant."""
    values = random_states(0, DT, COUNT)
    measured, times = np.array([[180.0, 120, 6], [170, 110, 5.5]]), np.array([0.0, 2 * DT])
    half_turn = gtsam.Pose3(gtsam.Rot3.Ry(np.pi - 0.01), np.zeros(3))
    values.update(X(2), values.atPose3(X(0)).compose(half_turn))
    factor = structureless((measured, times, np.zeros(2, int)))
    constant = 0.5 * np.sum((2 * CAMERA.fx / NOISE.sigmas()) ** 2)
    np.testing.assert_allclose(factor.error(values), constant, rtol=1e-12)
    for found in information([factor], values):
        assert np.abs(found).max() < 1e-9


def test_states_without_measurements_are_left_out() -> None:
    _, (measured, times, number) = scene(0)
    early = times < DT
    factor = structureless((measured[early], times[early], number[early]))
    assert list(factor.keys()) == KEYS[:4]


GOOD = np.array([[180.0, 120.0, 6.0], [181.0, 120.0, 6.0]])
TWO = gtsam.noiseModel.Unit.Create(2)


def made(
    measured: Any = GOOD,
    times: Any = (0.01, 0.02),
    landmarks: Any = (1, 1),
    model: Any = NOISE,
    states: Any = tuple(STATES),
    qc: Any = None,
) -> object:
    return StructurelessStereoFactor(measured, times, landmarks, model, states, CAMERA, qc)


CASES: list[tuple[str, Callable[[], object]]] = [
    ("measured", lambda: made(GOOD[:1], [0.01], [1])),
    ("measured", lambda: made(GOOD[:, :2])),
    ("measured", lambda: made(GOOD * np.nan)),
    ("measured", lambda: made(GOOD * [1, 1, -1])),
    ("times", lambda: made(times=[0.01])),
    ("times", lambda: made(times=[0.01, np.nan])),
    ("times", lambda: made(times=[0.01, 0.2])),
    ("times", lambda: made(times=[-0.01, 0.02])),
    ("landmarks", lambda: made(landmarks=[1])),
    ("landmarks", lambda: made(landmarks=[1.0, 1.0])),
    ("landmarks", lambda: made(landmarks=[[1], [1]])),
    ("landmarks", lambda: made(landmarks=["a", "b"])),
    ("model", lambda: made(model=TWO)),
    ("model", lambda: made(model=1.0)),
    ("states", lambda: made(states=STATES[::-1])),
    ("states", lambda: made(states=STATES[:1])),
    ("qc", lambda: made(qc=-QC)),
    ("qc", lambda: made(qc=np.diag(QC) + 1e-4)),
]


@pytest.mark.parametrize(("name", "call"), CASES)
def test_the_argument_is_named(name: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=f"^{name}"):
        call()


MOUNTED = se3_exp([0.1, -0.2, 0.15, 0.05, -0.1, 0.2])


def of_the_body(values: gtsam.Values) -> gtsam.Values:
    """States of the body that carries the camera at MOUNTED."""
    found = gtsam.Values()
    for pose, velocity, _ in STATES:
        T = values.atPose3(pose).matrix() @ se3_inverse(MOUNTED)
        found.insert(pose, gtsam.Pose3(T))
        found.insert(velocity, se3_adjoint(MOUNTED) @ values.atVector(velocity))
    return found


@given(seed=seeds)
@examples
def test_a_camera_in_the_body_tells_of_the_body_what_it_tells_of_itself(seed: int) -> None:
    """Rows by the body's states are those by the camera's, times how these move with the body."""
    values, data = scene(seed)
    camera = structureless(data)
    body = StructurelessStereoFactor(*data, NOISE, STATES, CAMERA, T_body_cam=MOUNTED)
    at = of_the_body(values)
    np.testing.assert_allclose(body.error(at), camera.error(values), rtol=1e-9)
    A, b = camera.linearize(values).jacobian()
    A_body, b_body = body.linearize(at).jacobian()
    by_body = np.kron(np.eye(len(KEYS)), se3_adjoint(se3_inverse(MOUNTED)))
    H, gradient = by_body.T @ A.T @ A @ by_body, by_body.T @ A.T @ b
    assert_same(A_body.T @ A_body, H, 1e-7)
    assert_same(A_body.T @ b_body, gradient, 1e-7)
    assert_same(body.residuals(at), camera.residuals(values))
    S = np.random.default_rng(seed).normal(size=(36, 36))
    covariance = S @ S.T * 1e-6
    new = data[0] + 0.5, data[1], data[2]
    expected = camera.squared_distances(values, *new, by_body @ covariance @ by_body.T)
    np.testing.assert_allclose(body.squared_distances(at, *new, covariance), expected, rtol=1e-6)


def test_gtsams_measurements_are_converted_with_their_noise() -> None:
    values, (measured, times, number) = scene(3)
    theirs = [gtsam.StereoPoint2(u, u - disparity, v) for u, v, disparity in measured]
    mixing = np.array([[1.0, 0, 0], [1, 0, -1], [0, 1, 0]])  # (u_left, u_right, v) of ours
    covariance = mixing @ np.diag(NOISE.sigmas() ** 2) @ mixing.T
    model = gtsam.noiseModel.Gaussian.Covariance(covariance)
    states = [gtsam.StateData(*each) for each in STATES]
    found = StructurelessStereoFactor(theirs, times, number, model, states, CAMERA.to_gtsam())
    expected = structureless((measured, times, number))
    np.testing.assert_allclose(found.error(values), expected.error(values), rtol=1e-10)


def test_a_body_has_no_prior_of_its_camera() -> None:
    _, data = scene(0)
    with pytest.raises(ValueError, match="T_body_cam"):
        StructurelessStereoFactor(*data, NOISE, STATES, CAMERA, QC, T_body_cam=MOUNTED)


def test_measurements_of_two_kinds_are_refused() -> None:
    points = [np.array([180.0, 120.0, 6.0]), gtsam.StereoPoint2(180.0, 174.0, 120.0)]
    states = [(X(k), V(k), 0.1 * k) for k in range(2)]
    with pytest.raises(ValueError, match="measured must not mix StereoPoint2 and arrays"):
        StructurelessStereoFactor(points, [0.01, 0.02], 0, NOISE, states, CAMERA)
