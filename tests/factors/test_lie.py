"""SE(3): group axioms, and Jacobians as derivatives of the exponential, from zero to pi."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from factors.lie import (
    se3_adjoint,
    se3_curly,
    se3_exp,
    se3_inverse,
    se3_left_jacobian,
    se3_left_jacobian_inverse,
    se3_log,
    se3_right_jacobian,
    se3_right_jacobian_inverse,
    skew,
)

Array = NDArray[np.float64]


@st.composite
def twists(draw: st.DrawFn, largest_angle: float = np.pi) -> Array:
    """Twists of any direction; angles of all magnitudes, zero and the largest among them."""
    direction = np.array([draw(st.floats(-1, 1)) for _ in range(3)])
    size = np.linalg.norm(direction)
    direction = direction / size if size > 1e-3 else np.array([0.0, 0.0, 1.0])
    angle = draw(
        st.one_of(
            st.sampled_from([0.0, 1e-12, 1e-8, 1e-4, largest_angle]), st.floats(0, largest_angle)
        )
    )
    return np.r_[angle * direction, [draw(st.floats(-5, 5)) for _ in range(3)]]


def hat(xi: Array) -> Array:
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = skew(xi[:3]), xi[3:]
    return matrix


@given(twists())
@settings(deadline=None, max_examples=40)
def test_exp_is_the_matrix_exponential(xi: Array) -> None:
    np.testing.assert_allclose(se3_exp(xi), expm(hat(xi)), atol=1e-13)
    np.testing.assert_allclose(se3_adjoint(se3_exp(xi)), expm(se3_curly(xi)), atol=1e-12)


@given(twists())
@settings(deadline=None, max_examples=40)
def test_log_undoes_exp(xi: Array) -> None:
    T = se3_exp(xi)
    np.testing.assert_allclose(se3_exp(se3_log(T)), T, atol=1e-14 * (1 + np.abs(xi).max()))
    if np.linalg.norm(xi[:3]) < np.pi - 1e-6:
        np.testing.assert_allclose(se3_log(T), xi, rtol=1e-12, atol=1e-14)


@given(twists(), twists())
@settings(deadline=None, max_examples=40)
def test_inverse_and_adjoint(xi: Array, other: Array) -> None:
    T = se3_exp(xi)
    np.testing.assert_allclose(T @ se3_inverse(T), np.eye(4), atol=1e-14)
    np.testing.assert_allclose(se3_inverse(T), se3_exp(-xi), atol=1e-13)
    moved = se3_exp(se3_adjoint(T) @ other)
    np.testing.assert_allclose(T @ se3_exp(other) @ se3_inverse(T), moved, atol=1e-12)


@given(twists(2 * np.pi - 0.1))
@settings(deadline=None, max_examples=40)
def test_jacobian_is_the_mean_of_the_adjoint(xi: Array) -> None:
    """J = integral of Exp(s ad(xi)) over s from 0 to 1, here by Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    mean = sum(
        w / 2 * expm((s + 1) / 2 * se3_curly(xi)) for s, w in zip(nodes, weights, strict=True)
    )
    np.testing.assert_allclose(se3_left_jacobian(xi), mean, atol=1e-12)


@given(twists(2 * np.pi - 0.1))
@settings(deadline=None, max_examples=40)
def test_jacobians_are_inverse_and_adjoint_to_each_other(xi: Array) -> None:
    left, right = se3_left_jacobian(xi), se3_right_jacobian(xi)
    inverse = se3_left_jacobian_inverse(xi)
    size = np.abs(inverse).max()
    np.testing.assert_allclose(left @ inverse, np.eye(6), atol=1e-13 * size)
    np.testing.assert_allclose(right @ se3_right_jacobian_inverse(xi), np.eye(6), atol=1e-13 * size)
    np.testing.assert_allclose(left, se3_adjoint(se3_exp(xi)) @ right, atol=1e-12)


@given(st.lists(twists(), min_size=1, max_size=4))
@settings(deadline=None, max_examples=20)
def test_batches_are_the_elements_one_by_one(xi: list[Array]) -> None:
    batch = np.array([xi, xi])
    for function in (se3_exp, se3_curly, se3_left_jacobian, se3_right_jacobian_inverse):
        one_by_one = np.array([[function(x) for x in row] for row in batch])
        np.testing.assert_array_equal(function(batch), one_by_one)
    T = se3_exp(batch)
    for function in (se3_log, se3_inverse, se3_adjoint):
        one_by_one = np.array([[function(x) for x in row] for row in T])
        np.testing.assert_allclose(function(T), one_by_one, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize("bad", [np.zeros(5), np.zeros((6, 2)), np.full(6, np.nan)])
def test_bad_twists_are_named(bad: Array) -> None:
    with pytest.raises(ValueError, match="xi must"):
        se3_exp(bad)


@pytest.mark.parametrize("jacobian", [se3_right_jacobian, se3_right_jacobian_inverse])
def test_unsigned_twists_are_as_good(jacobian: Any) -> None:
    xi = np.array([1, 0, 0, 2, 0, 0])
    np.testing.assert_array_equal(jacobian(xi.astype(np.uint8)), jacobian(xi))


def test_poses_of_a_matrix_exponential_are_poses_though_rounding_left_their_last_row() -> None:
    twist = np.array([0.9, -0.5, 1.1, 0.3, 2.0, -1.0])
    wedge = np.zeros((4, 4))
    wedge[:3, :3] = skew(twist[:3])
    wedge[:3, 3] = twist[3:]
    T = expm(wedge)
    T[3] += [3e-16, -2e-16, 1e-16, 2e-16]
    np.testing.assert_allclose(se3_log(T), twist, atol=1e-14)
    T[3, 0] = 1e-6
    with pytest.raises(ValueError, match="T must be poses"):
        se3_log(T)
