"""A factor that is linear in how far states have moved."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from graphs import assert_derivatives_match, random_states, seeds, state
from gtsam.symbol_shorthand import V, X
from hypothesis import given, settings
from numpy.typing import NDArray
from windows import graph_of, keys, moved_world, retracted

from factors import LinearStatesFactor, optimize
from factors.lie import se3_exp

Array = NDArray[np.float64]

examples = settings(deadline=None, max_examples=10, derandomize=True)


def factor_of(seed: int, count: int = 2, rows: int = 30) -> tuple[LinearStatesFactor, Array]:
    """Random rows, and the states X(k), V(k) of `random_states` that it counts from."""
    values, rng = random_states(seed, 0.1, count), np.random.default_rng(seed)
    T, v = (np.array(part) for part in zip(*(state(values, k) for k in range(count)), strict=True))
    J = rng.normal(size=(rows, 12 * count + 1))
    return LinearStatesFactor(keys(0, count), T, v, J), J


@given(seeds)
@examples
def test_derivative_is_exact_where_it_was_linearised(seed: int) -> None:
    factor, J = factor_of(seed)
    values = random_states(seed, 0.1)
    assert_derivatives_match(factor, values)
    A, b = factor.linearize(values).jacobian()
    np.testing.assert_allclose(A, J[:, :-1], atol=1e-12)
    np.testing.assert_allclose(b, -J[:, -1], atol=1e-12)


@given(seeds)
@examples
def test_errors_are_linear_in_the_step(seed: int) -> None:
    """However far the states move, up to half a turn."""
    factor, J = factor_of(seed, 3)
    step = np.random.default_rng(seed).uniform(-1.8, 1.8, 36)
    moved = random_states(seed, 0.1, 3)
    for k in range(3):
        T, v = state(moved, k)
        change = step[12 * k : 12 * k + 12]
        moved.update(X(k), gtsam.Pose3(T @ se3_exp(change[:6])))
        moved.update(V(k), v + change[6:])
    expected = J[:, :-1] @ step + J[:, -1]
    np.testing.assert_allclose(factor.whitenedError(moved), expected, atol=1e-9)


@given(seeds)
@examples
def test_the_world_frame_of_states_and_factor_does_not_matter(seed: int) -> None:
    S = se3_exp(3 * np.random.default_rng(seed).normal(size=6))
    here, J = factor_of(seed)
    values = random_states(seed, 0.1)
    T, v = (np.array(part) for part in zip(*(state(values, k) for k in range(2)), strict=True))
    there = LinearStatesFactor(keys(0, 2), S @ T, v, J)
    moved = retracted(values, np.full(24, 0.1), keys(0, 2))
    far = moved_world(moved, S)
    np.testing.assert_allclose(there.whitenedError(far), here.whitenedError(moved), atol=1e-9)


def test_its_optimum_is_that_of_the_least_squares() -> None:
    factor, J = factor_of(1)
    rows = J.copy()
    rows[:, -1] *= 1e-3
    values = random_states(1, 0.1)
    T, v = (np.array(part) for part in zip(*(state(values, k) for k in range(2)), strict=True))
    factor = LinearStatesFactor(keys(0, 2), T, v, rows)
    best = optimize(graph_of(factor), values)
    _, squares = np.linalg.lstsq(rows[:, :-1], -rows[:, -1], rcond=None)[:2]
    assert factor.error(best) == pytest.approx(0.5 * squares[0], rel=1e-6)


def test_states_that_are_handed_over_may_change_afterwards() -> None:
    values = random_states(0, 0.1)
    T, v = (np.array(part) for part in zip(*(state(values, k) for k in range(2)), strict=True))
    rows = np.random.default_rng(0).normal(size=(4, 25))
    factor = LinearStatesFactor(keys(0, 2), T, v, rows)
    before = factor.whitenedError(values)
    T[:], v[:] = 0.0, 1.0
    np.testing.assert_array_equal(factor.whitenedError(values), before)
