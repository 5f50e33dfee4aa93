"""Losses written down for the kernels are those of GTSAM."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import NOISE
from gtsam.symbol_shorthand import X
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray
from windows import Window

from factors.structureless.robust_losses import SQUARE, Loss, loss_kernel

ESTIMATORS = gtsam.noiseModel.mEstimator
KNOWN = [ESTIMATORS.Huber, ESTIMATORS.Cauchy, ESTIMATORS.GemanMcClure]
OTHERS = [ESTIMATORS.Fair, ESTIMATORS.Tukey, ESTIMATORS.Welsch, ESTIMATORS.DCS]
scales = st.floats(1e-3, 1e3)
distances = st.lists(st.floats(0, 1e6), min_size=1, max_size=10).map(np.array)


def of_kernel(distances: NDArray[np.float64], parameters: NDArray[np.float64]) -> Any:
    """Loss, weight and second derivative (n, 3)."""
    return np.array([_called(d * d, parameters) for d in distances])


@njit
def _called(square: float, parameters: NDArray[np.float64]) -> tuple[float, float, float]:
    return loss_kernel(square, parameters)


@pytest.mark.parametrize("estimator", KNOWN + OTHERS)
@given(scale=scales, distances=distances)
@settings(deadline=None, max_examples=30)
def test_losses_and_weights_are_gtsams(
    estimator: Any, scale: float, distances: NDArray[np.float64]
) -> None:
    robust = estimator.Create(scale)
    loss = Loss(gtsam.noiseModel.Robust.Create(robust, NOISE))
    assert (loss.parameters[0] == SQUARE) == (estimator in OTHERS)
    expected = [robust.weight(d) for d in distances]
    np.testing.assert_allclose(loss.weights(distances), expected, rtol=1e-12)
    total = sum(robust.loss(d) for d in distances)
    np.testing.assert_allclose(loss.total(distances), total, rtol=1e-9)


@pytest.mark.parametrize("estimator", KNOWN)
@given(share=st.floats(0.0, 0.9) | st.floats(1.1, 10.0), scale=scales)
@settings(deadline=None, max_examples=30)
def test_second_derivative(estimator: Any, share: float, scale: float) -> None:
    """Of the loss by the error, which is weight times error derived."""
    robust, d, step = estimator.Create(scale), share * scale, 1e-5 * scale
    loss = Loss(gtsam.noiseModel.Robust.Create(robust, NOISE))
    slopes = [robust.weight(at) * at for at in (d - step, d + step)]
    numerical = (slopes[1] - slopes[0]) / (2 * step)
    second = of_kernel(np.array([d]), loss.parameters)[0, 2]
    np.testing.assert_allclose(second, numerical, rtol=0, atol=1e-8)


def test_without_a_loss_it_is_half_the_square() -> None:
    loss, distances = Loss(NOISE), np.array([0.0, 2.0, 1e6])
    np.testing.assert_array_equal(loss.weights(distances), 1.0)
    assert loss.total(distances) == 0.5 * np.sum(distances**2)
    np.testing.assert_array_equal(of_kernel(distances, loss.parameters)[:, 2], 1.0)


@pytest.mark.parametrize("name", ["Fair", "Tukey", "Welsch", "DCS", "AsymmetricCauchy"])
def test_landmarks_are_at_the_optimum_of_every_loss(name: str) -> None:
    """So that the cost changes with the states as its gradient says."""
    window = Window.simulated(3, 6, seen=6, noise=1.0, qc=None, seed=4)
    robust = getattr(ESTIMATORS, name).Create(1.0)
    factor = window.factor(model=gtsam.noiseModel.Robust.Create(robust, NOISE))
    at, step = window.truth, 1e-5
    graph = gtsam.GaussianFactorGraph()
    graph.push_back(factor.linearize(at))
    gradient = graph.gradientAtZero().at(X(1))
    moved = [gtsam.Values(at) for _ in range(2)]
    for values, sign in zip(moved, (1, -1), strict=True):
        values.update(X(1), at.atPose3(X(1)).retract(sign * step * np.eye(6)[3]))
    numerical = (factor.error(moved[0]) - factor.error(moved[1])) / (2 * step)
    np.testing.assert_allclose(gradient[3], numerical, rtol=2e-3)


def test_a_loss_that_weighs_larger_errors_more_is_refused() -> None:
    dead_zone = gtsam.noiseModel.Robust.Create(ESTIMATORS.L2WithDeadZone.Create(1.0), NOISE)
    with pytest.raises(ValueError, match="model must not give larger errors more weight"):
        Loss(dead_zone)
