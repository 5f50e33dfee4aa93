"""With Q_c every measurement's time is a state of its own, eliminated with the landmarks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, derivative
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray
from windows import (
    NOISE,
    QC,
    Window,
    chain,
    graph_of,
    in_sigmas,
    keys,
    local_step,
    mean_and_covariance,
    moved_world,
    retracted,
    values_of,
)

from factors import (
    LandmarkPrior,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    gauss_newton_parameters,
    optimize,
)
from factors.lie import se3_exp

Array = NDArray[np.float64]

ESTIMATORS = gtsam.noiseModel.mEstimator
HUBER = gtsam.noiseModel.Robust.Create(ESTIMATORS.Huber.Create(1.0), NOISE)
FAIR = gtsam.noiseModel.Robust.Create(ESTIMATORS.Fair.Create(1.0), NOISE)
MODELS = pytest.mark.parametrize("model", [NOISE, HUBER, FAIR], ids=["gaussian", "huber", "fair"])
WINDOW = Window.simulated(3, 8, seen=6, noise=1.0, qc=QC, seed=2)
NEAR = retracted(WINDOW.truth, np.random.default_rng(0).normal(size=36) * 3e-3, keys(0, 3))


def information(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> tuple[Array, Array]:
    """Hessian and gradient of half the squared error by the states."""
    ordering = gtsam.Ordering()
    for key in keys(0, 3):
        ordering.push_back(key)
    H, minus_gradient = graph_of(factor).linearize(values).hessian(ordering)
    return H, -minus_gradient


def units(H: Array) -> Array:
    scale = np.sqrt(np.diag(H))
    return np.outer(scale, scale)


def test_optimum_is_that_of_the_literal_graph() -> None:
    """Both solved to the end, with noise: hundredths of a standard deviation."""
    factor = WINDOW.factor(0, QC)
    graph = graph_of(WINDOW.chain(0, 2), factor)
    solved = optimize(graph, NEAR, gauss_newton_parameters(30, 1e-12))
    covariance = mean_and_covariance(graph, solved, keys(0, 3))[1]
    every = values_of(WINDOW.T_all, WINDOW.v_all)
    literal = chain(WINDOW.t_all, 0, len(WINDOW.t_all) - 1, WINDOW.truth)
    for n, point in zip(*factor.landmarks(WINDOW.truth), strict=True):
        if np.count_nonzero(WINDOW.landmark == n) > 1:
            every.insert(L(int(n)), point)
    for t, n, measured in zip(WINDOW.t, WINDOW.landmark.tolist(), WINDOW.measured, strict=True):
        if every.exists(L(n)):
            k = int(WINDOW.t_all.searchsorted(t))
            literal.push_back(StereoReprojectionFactor(measured, NOISE, X(k), L(n), CAMERA))
    reference = optimize(literal, every, gauss_newton_parameters(30, 1e-12))
    at = WINDOW.t_all.searchsorted(WINDOW.t_states).tolist()
    pairs = [(states(solved, k), states(reference, n)) for k, n in enumerate(at)]
    apart = np.concatenate([local_step(*found, *expected) for found, expected in pairs])
    assert in_sigmas(apart, np.zeros(36), covariance) < 0.03


def states(values: gtsam.Values, k: int) -> tuple[Array, Array]:
    return values.atPose3(X(k)).matrix(), values.atVector(V(k))


@pytest.mark.parametrize(
    ("model", "tolerance"),
    [(NOISE, 0.002), (HUBER, 0.1), (FAIR, 0.1)],
    ids=["gaussian", "huber", "fair"],
)
def test_gradient_to_first_order_in_what_is_eliminated(model: Any, tolerance: float) -> None:
    """Robust weights are those of the interpolated states."""
    factor = WINDOW.factor(0, QC, None, 1e-14, model)
    H, gradient = information(factor, NEAR)
    numerical = np.concatenate([derivative(factor.error, NEAR, key, 1e-6) for key in keys(0, 3)])
    scale = np.sqrt(np.diag(H))
    apart = np.linalg.norm((gradient - numerical) / scale)
    assert apart < tolerance * np.linalg.norm(gradient / scale)


def test_cost_is_half_the_squared_error_of_the_linearisation() -> None:
    factor = WINDOW.factor(0, QC)
    b = factor.linearize(NEAR).jacobian()[1]
    np.testing.assert_allclose(factor.error(NEAR), 0.5 * b @ b, rtol=1e-9)


@MODELS
def test_without_deviations_it_is_the_interpolated_one(model: Any) -> None:
    still = information(WINDOW.factor(0, 1e-12 * QC, None, 1e-14, model), NEAR)
    straight = information(WINDOW.factor(0, None, None, 1e-14, model), NEAR)
    for found, expected in zip(still, straight, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@MODELS
def test_deviations_only_take_information_away(model: Any) -> None:
    """The more, the larger Q_c."""
    wider = [None, 0.1 * QC, QC, 10 * QC]
    found = [information(WINDOW.factor(0, qc, None, 1e-14, model), NEAR)[0] for qc in wider]
    for more, less in pairwise(found):
        assert np.linalg.eigvalsh((more - less) / units(found[0]))[0] > -1e-9


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-4])
def test_the_tolerance_bounds_what_is_lost(tolerance: float) -> None:
    exact = information(WINDOW.factor(0, QC, None, 1e-14), NEAR)[0]
    found = information(WINDOW.factor(0, QC, None, tolerance), NEAR)[0]
    assert np.abs((found - exact) / units(exact)).max() < tolerance


@MODELS
def test_the_order_of_the_measurements_does_not_matter(model: Any) -> None:
    order = np.random.default_rng(1).permutation(len(WINDOW.t))
    data = WINDOW.measured[order], WINDOW.t[order], WINDOW.landmark[order]
    factor = StructurelessStereoFactor(*data, model, WINDOW.states, CAMERA, QC, None, 1e-14)
    found = factor.linearize(NEAR).jacobian()
    expected = WINDOW.factor(0, QC, None, 1e-14, model).linearize(NEAR).jacobian()
    for each, same in zip(found, expected, strict=True):
        np.testing.assert_array_equal(each, same)


@MODELS
def test_the_world_frame_does_not_matter(model: Any) -> None:
    far = moved_world(NEAR, se3_exp(np.array([0.5, -1.0, 0.7, 2.0, -3.0, 1.0])))
    factor = WINDOW.factor(0, QC, None, 1e-14, model)
    for found, expected in zip(information(factor, far), information(factor, NEAR), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    assert factor.error(far) == pytest.approx(factor.error(NEAR), rel=1e-7)


def test_all_states_are_in_the_factor() -> None:
    """A prior of landmarks counts from the first of them, measured or not."""
    early = WINDOW.t < WINDOW.t_states[1]
    data = WINDOW.measured[early], WINDOW.t[early], WINDOW.landmark[early]
    for options in ((QC, None), (None, LandmarkPrior.none())):
        factor = StructurelessStereoFactor(*data, NOISE, WINDOW.states, CAMERA, *options)
        assert list(factor.keys()) == keys(0, 3)


def test_two_measurements_at_one_time_are_one_state() -> None:
    """Half the landmarks twice, under other numbers, at the same times."""
    data = WINDOW.measured, WINDOW.t, WINDOW.landmark
    twice = [np.concatenate(pair) for pair in zip(data, (*data[:2], data[2] + 100), strict=True)]
    factor = StructurelessStereoFactor(*twice, NOISE, WINDOW.states, CAMERA, QC)
    between = factor.states_between(NEAR)
    np.testing.assert_array_equal(between.t, np.unique(WINDOW.t))
    sharper = gtsam.noiseModel.Diagonal.Sigmas(NOISE.sigmas() / np.sqrt(2))
    once = StructurelessStereoFactor(*data, sharper, WINDOW.states, CAMERA, QC)
    found, expected = information(factor, NEAR), information(once, NEAR)
    for each, same in zip(found, expected, strict=True):
        np.testing.assert_allclose(each, same, rtol=0, atol=1e-3 * np.abs(same).max())


def test_a_measurement_of_half_the_variance_counts_as_two() -> None:
    """Every third measurement twice, or once with a smaller deviation; the prediction as well."""
    data, rows = (WINDOW.measured, WINDOW.t, WINDOW.landmark), np.arange(0, len(WINDOW.t), 3)
    twice = [np.concatenate([column, column[rows]]) for column in data]
    doubled = StructurelessStereoFactor(*twice, NOISE, WINDOW.states, CAMERA, QC, tolerance=1e-14)
    deviations = np.ones((len(WINDOW.t), 3))
    deviations[rows] = np.sqrt(0.5)
    options = NOISE, WINDOW.states, CAMERA, QC, None, 1e-14, None
    weighted = StructurelessStereoFactor(*data, *options, deviations)
    found, expected = information(weighted, NEAR), information(doubled, NEAR)
    for each, same in zip(found, expected, strict=True):
        np.testing.assert_allclose(each, same, rtol=0, atol=1e-7 * np.abs(same).max())
    # What is predicted has the noise of the new measurement, too.
    new = [column[:5] for column in data]
    near, far = (
        weighted.squared_distances(NEAR, *new, 1e-9 * np.eye(36), scale * np.ones((5, 3)))
        for scale in (1e2, 1e3)
    )
    np.testing.assert_allclose(near, 1e2 * far, rtol=1e-2)


@pytest.mark.parametrize("scale", [0.5, 3.0])
@MODELS
def test_deviations_are_multiples_of_the_models(model: Any, scale: float) -> None:
    data = WINDOW.measured, WINDOW.t, WINDOW.landmark
    options = WINDOW.states, CAMERA, QC, None, 1e-4, None
    each = np.full((len(WINDOW.t), 3), scale)
    found = StructurelessStereoFactor(*data, model, *options, each)
    gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
    wider: Any = gtsam.noiseModel.Gaussian.Covariance(scale**2 * gaussian.covariance())
    if isinstance(model, gtsam.noiseModel.Robust):
        wider = gtsam.noiseModel.Robust.Create(model.robust(), wider)
    expected = StructurelessStereoFactor(*data, wider, *options)
    assert found.error(NEAR) == pytest.approx(expected.error(NEAR), rel=1e-9)


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
def test_deviations_are_positive(wrong: float) -> None:
    data = WINDOW.measured, WINDOW.t, WINDOW.landmark
    deviations = np.ones((len(WINDOW.t), 3))
    deviations[3, 1] = wrong
    with pytest.raises(ValueError, match="deviations"):
        StructurelessStereoFactor(*data, NOISE, WINDOW.states, CAMERA, deviations=deviations)
    with pytest.raises(ValueError, match="deviations"):
        StructurelessStereoFactor(*data, NOISE, WINDOW.states, CAMERA, deviations=deviations[:3])


@MODELS
def test_a_half_turn_stays_finite(model: Any) -> None:
    values = gtsam.Values(NEAR)
    turn = gtsam.Pose3(gtsam.Rot3.Ry(np.pi - 0.01), np.zeros(3))
    values.update(X(2), values.atPose3(X(2)).compose(turn))
    factor = WINDOW.factor(0, QC, None, 1e-4, model)
    A, b = factor.linearize(values).jacobian()
    assert np.isfinite(A).all()
    assert np.isfinite(b).all()
    assert np.isfinite(factor.error(values))
    T, v = factor.states_between(values).states()
    assert np.isfinite(T).all()
    assert np.isfinite(v).all()


@MODELS
def test_a_window_in_which_nothing_is_seen_says_nothing(model: Any) -> None:
    """All tracks were lost: no measurement, no landmark."""
    none, prior = (np.empty((0, 3)), [], np.empty(0, int)), LandmarkPrior.none()
    factor = StructurelessStereoFactor(*none, model, WINDOW.states, CAMERA, QC, prior)
    assert factor.error(NEAR) == 0.0
    assert not np.any(factor.linearize(NEAR).jacobian()[0])
    assert factor.residuals(NEAR).shape == (0, 3)
    assert len(factor.landmarks(NEAR)[0]) == 0
    found = factor.squared_distances(NEAR, WINDOW.measured, WINDOW.t, WINDOW.landmark, np.eye(36))
    assert np.isnan(found).all()


@pytest.mark.parametrize("tolerance", [-1e-9, np.nan])
def test_tolerance_is_not_negative(tolerance: float) -> None:
    with pytest.raises(ValueError, match="tolerance must"):
        WINDOW.factor(0, QC, None, tolerance)


@pytest.mark.parametrize("qc", [None, QC], ids=["interpolated", "own states"])
@pytest.mark.parametrize("key", [X(1), V(1)])
def test_a_state_that_is_no_number_has_an_error_that_is_none(qc: Any, key: int) -> None:
    """Not the constant one of a point behind the camera."""
    factor, values = WINDOW.factor(0, qc), gtsam.Values(NEAR)
    values.update(key, gtsam.Pose3(np.full((4, 4), np.nan)) if key == X(1) else np.full(6, np.nan))
    assert np.isnan(factor.error(values))
    assert np.isnan(factor.linearize(values).jacobian()[1]).any()
