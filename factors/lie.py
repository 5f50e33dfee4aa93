"""SE(3) in closed form, exact from zero to pi: exponential, logarithm, adjoints, Jacobians.

Twists are (rotation, translation), shape (..., 6); transforms are (..., 4, 4); leading axes are
batches. Barfoot, "State Estimation for Robotics", chapter 7, with the halves of a twist swapped.

The public functions are batched; those that end in `_kernel` work on one element inside numba code.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_TERMS = 22  # enough for 1e-16 at an angle of pi
_SERIES_LIMIT = 10.0  # largest squared angle that is summed as a series


def _series(power: int, shift: int, first: int) -> list[float]:
    """Coefficients in theta^2 of N(theta) / (2 theta^power), N as in `_jacobian_coefficients`."""
    odd = power % 2
    return [
        (-1) ** m * (2 * m + odd - shift) / factorial(2 * m + odd) / 2
        for m in range(first, first + _TERMS)
    ]


# Of the left Jacobian 1 + g1 ad + g2 ad^2 + g3 ad^3 + g4 ad^4.
_G = np.array([_series(2, 4, 1), _series(3, 5, 1), _series(4, 2, 2), _series(5, 3, 2)])
# sin(w)/w, (1 - cos w)/w^2, (w - sin w)/w^3
_ROTATION = np.array([[(-1) ** m / factorial(2 * m + k) for m in range(_TERMS)] for k in (1, 2, 3)])


@njit(cache=True)
def _horner(coefficients: Array, s: float) -> float:
    total = 0.0
    for i in range(len(coefficients) - 1, -1, -1):
        total = total * s + coefficients[i]
    return total


@njit(cache=True)
def _horner_derivative(coefficients: Array, s: float) -> float:
    total = 0.0
    for i in range(len(coefficients) - 1, 0, -1):
        total = total * s + i * coefficients[i]
    return total


@njit(cache=True)
def _rotation_coefficients(s: float) -> tuple[float, float, float]:
    """sin(w)/w, (1 - cos w)/w^2 and (w - sin w)/w^3 of the squared angle s = w^2."""
    if s < 1.0:
        return _horner(_ROTATION[0], s), _horner(_ROTATION[1], s), _horner(_ROTATION[2], s)
    w = np.sqrt(s)
    half = np.sin(w / 2)
    return np.sin(w) / w, 2 * half * half / s, (w - np.sin(w)) / (w * s)


@njit(cache=True)
def _jacobian_coefficients(s: float) -> tuple[Array, Array]:
    """g1..g4 of the left Jacobian, and 2 dg/ds, at the squared angle s.

    g_k = N_k / (2 w^(k+1)) with N = 4 - w sin - 4 cos, 4w - 5 sin + w cos, 2 - w sin - 2 cos and
    2w - 3 sin + w cos.
    """
    g, slope = np.empty(4), np.empty(4)
    if s < _SERIES_LIMIT:
        for k in range(4):
            g[k] = _horner(_G[k], s)
            slope[k] = 2 * _horner_derivative(_G[k], s)
        return g, slope
    w = np.sqrt(s)
    sin, cos = np.sin(w), np.cos(w)
    value = (4 - w * sin - 4 * cos, 4 * w - 5 * sin + w * cos, 2 - w * sin - 2 * cos,
             2 * w - 3 * sin + w * cos)  # fmt: skip
    change = (3 * sin - w * cos, 4 - 4 * cos - w * sin, sin - w * cos, 2 - 2 * cos - w * sin)
    for k in range(4):
        power = k + 2
        g[k] = value[k] / (2 * w**power)
        slope[k] = (change[k] * w - power * value[k]) / (2 * w ** (power + 2))
    return g, slope


@njit(cache=True)
def skew_kernel(a: Array) -> Array:
    """(3, 3) matrix of the cross product with a (3,)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@njit(cache=True)
def curly_kernel(xi: Array) -> Array:
    """(6, 6) small adjoint of a twist."""
    result = np.zeros((6, 6))
    result[:3, :3] = skew_kernel(xi[:3])
    result[3:, 3:] = result[:3, :3]
    result[3:, :3] = skew_kernel(xi[3:])
    return result


@njit(cache=True)
def exp_kernel(xi: Array) -> Array:
    """(4, 4) transform of a twist."""
    W = skew_kernel(xi[:3])
    WW = W @ W
    a, b, c = _rotation_coefficients(xi[:3] @ xi[:3])
    T = np.eye(4)
    T[:3, :3] += a * W + b * WW
    T[:3, 3] = xi[3:] + b * (W @ xi[3:]) + c * (WW @ xi[3:])
    return T


@njit(cache=True)
def log_kernel(T: Array) -> Array:
    """(6,) twist of a transform, rotation angle at most pi."""
    xi = np.empty(6)
    xi[:3] = _rotation_log(T)
    W = skew_kernel(xi[:3])
    t = np.ascontiguousarray(T[:3, 3])
    xi[3:] = t - 0.5 * (W @ t) + _inverse_coefficient(xi[:3] @ xi[:3]) * (W @ (W @ t))
    return xi


@njit(cache=True)
def _inverse_coefficient(s: float) -> float:
    """d of the inverse left Jacobian of SO(3), 1 - W/2 + d W^2: (1 - w/2 cot(w/2)) / w^2."""
    a, b, _ = _rotation_coefficients(s)
    if s < 1.0:  # where 1 - a / (2 b) would cancel
        return _horner_difference(s) / (2 * b)
    return (1 - a / (2 * b)) / s


@njit(cache=True)
def _horner_difference(s: float) -> float:
    """(2 (1 - cos w)/w^2 - sin(w)/w) / w^2."""
    total = 0.0
    for i in range(_TERMS - 1, 0, -1):
        total = total * s + (2 * _ROTATION[1, i] - _ROTATION[0, i])
    return total


@njit(cache=True)
def _rotation_log(T: Array) -> Array:
    """(3,) rotation vector through the quaternion with the largest component (Shepperd)."""
    trace = T[0, 0] + T[1, 1] + T[2, 2]
    q = np.empty(4)  # x, y, z, w
    i = 0
    for k in range(1, 3):
        if T[k, k] > T[i, i]:
            i = k
    if trace > T[i, i]:
        q[3] = 1 + trace
        q[0], q[1], q[2] = T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1 - trace + 2 * T[i, i]
        q[j], q[k] = T[i, j] + T[j, i], T[i, k] + T[k, i]
        q[3] = T[k, j] - T[j, k]
    if q[3] < 0:
        q = -q
    size = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    if size < 1e-12 * q[3]:
        return 2 * q[:3] / q[3]
    return 2 * np.arctan2(size, q[3]) / size * q[:3]


@njit(cache=True)
def adjoint_kernel(T: Array) -> Array:
    """(6, 6) adjoint of a transform."""
    result = np.zeros((6, 6))
    result[:3, :3] = T[:3, :3]
    result[3:, 3:] = T[:3, :3]
    result[3:, :3] = skew_kernel(T[:3, 3]) @ np.ascontiguousarray(T[:3, :3])
    return result


@njit(cache=True)
def inverse_kernel(T: Array) -> Array:
    """(4, 4) inverse of a transform."""
    result = np.eye(4)
    result[:3, :3] = T[:3, :3].T
    for i in range(3):
        result[i, 3] = -(T[0, i] * T[0, 3] + T[1, i] * T[1, 3] + T[2, i] * T[2, 3])
    return result


@njit(cache=True)
def left_jacobian_kernel(xi: Array) -> Array:
    """(6, 6) left Jacobian: Exp(xi + d) = Exp(J d) Exp(xi) to first order."""
    g, _ = _jacobian_coefficients(xi[:3] @ xi[:3])
    A = curly_kernel(xi)
    AA = A @ A
    return np.eye(6) + g[0] * A + g[1] * AA + (g[2] * A + g[3] * AA) @ AA


@njit(cache=True)
def right_jacobian_kernel(xi: Array) -> Array:
    """(6, 6) right Jacobian: Exp(xi + d) = Exp(xi) Exp(J d) to first order."""
    return left_jacobian_kernel(-xi)


@njit(cache=True)
def left_jacobian_inverse_kernel(xi: Array) -> Array:
    """(6, 6) inverse of the left Jacobian; singular at an angle of 2 pi."""
    J = left_jacobian_kernel(xi)
    W = skew_kernel(xi[:3])
    rotation = np.eye(3) - 0.5 * W + _inverse_coefficient(xi[:3] @ xi[:3]) * (W @ W)
    result = np.zeros((6, 6))
    result[:3, :3] = rotation
    result[3:, 3:] = rotation
    result[3:, :3] = -rotation @ np.ascontiguousarray(J[3:, :3]) @ rotation
    return result


@njit(cache=True)
def right_jacobian_inverse_kernel(xi: Array) -> Array:
    """(6, 6) inverse of the right Jacobian."""
    return left_jacobian_inverse_kernel(-xi)


@njit(cache=True)
def right_jacobian_product_derivative_kernel(xi: Array, w: Array) -> Array:
    """(6, 6) derivative of Jr(xi) w by xi, w (6,) fixed."""
    A = -curly_kernel(xi)  # Jr(xi) = Jl(-xi)
    g, slope = _jacobian_coefficients(xi[:3] @ xi[:3])
    result = np.zeros((6, 6))
    power = np.empty((5, 6))  # A^n w
    power[0] = w
    for n in range(4):
        power[n + 1] = A @ power[n]
    # d(A^n w) = A d(A^(n-1) w) + dA A^(n-1) w and dA x = curly(x) dxi for A = -ad(xi).
    step = np.zeros((6, 6))
    for n in range(4):
        step = A @ step + curly_kernel(power[n])
        result += g[n] * step
        for i in range(6):
            for j in range(3):
                result[i, j] += slope[n] * power[n + 1, i] * xi[j]
    return result


def se3_exp(xi: ArrayLike) -> Array:
    """Transforms (..., 4, 4) of twists (..., 6)."""
    elements, results = _flat(xi, (6,), (4, 4))
    _exp_batch(elements.reshape(-1, *(6,)), results.reshape(-1, *(4, 4)))
    return results


@njit(cache=True)
def _exp_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = exp_kernel(elements[i])


def se3_log(T: ArrayLike) -> Array:
    """Twists (..., 6) of transforms (..., 4, 4), rotation angle at most pi."""
    elements, results = _flat(T, (4, 4), (6,))
    _log_batch(elements.reshape(-1, *(4, 4)), results.reshape(-1, *(6,)))
    return results


@njit(cache=True)
def _log_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = log_kernel(elements[i])


def se3_inverse(T: ArrayLike) -> Array:
    """Inverses of transforms (..., 4, 4)."""
    elements, results = _flat(T, (4, 4), (4, 4))
    _inverse_batch(elements.reshape(-1, *(4, 4)), results.reshape(-1, *(4, 4)))
    return results


@njit(cache=True)
def _inverse_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = inverse_kernel(elements[i])


def se3_adjoint(T: ArrayLike) -> Array:
    """Adjoints (..., 6, 6) of transforms (..., 4, 4)."""
    elements, results = _flat(T, (4, 4), (6, 6))
    _adjoint_batch(elements.reshape(-1, *(4, 4)), results.reshape(-1, *(6, 6)))
    return results


@njit(cache=True)
def _adjoint_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = adjoint_kernel(elements[i])


def se3_curly(xi: ArrayLike) -> Array:
    """Small adjoints (..., 6, 6) of twists (..., 6)."""
    elements, results = _flat(xi, (6,), (6, 6))
    _curly_batch(elements.reshape(-1, *(6,)), results.reshape(-1, *(6, 6)))
    return results


@njit(cache=True)
def _curly_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = curly_kernel(elements[i])


def se3_left_jacobian(xi: ArrayLike) -> Array:
    """Left Jacobians (..., 6, 6) of twists (..., 6)."""
    elements, results = _flat(xi, (6,), (6, 6))
    _left_jacobian_batch(elements.reshape(-1, *(6,)), results.reshape(-1, *(6, 6)))
    return results


@njit(cache=True)
def _left_jacobian_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = left_jacobian_kernel(elements[i])


def se3_right_jacobian(xi: ArrayLike) -> Array:
    """Right Jacobians (..., 6, 6) of twists (..., 6)."""
    elements, results = _flat(xi, (6,), (6, 6))
    _right_jacobian_batch(elements.reshape(-1, *(6,)), results.reshape(-1, *(6, 6)))
    return results


@njit(cache=True)
def _right_jacobian_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = right_jacobian_kernel(elements[i])


def se3_left_jacobian_inverse(xi: ArrayLike) -> Array:
    """Inverse left Jacobians (..., 6, 6) of twists (..., 6)."""
    elements, results = _flat(xi, (6,), (6, 6))
    _left_jacobian_inverse_batch(elements.reshape(-1, *(6,)), results.reshape(-1, *(6, 6)))
    return results


@njit(cache=True)
def _left_jacobian_inverse_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = left_jacobian_inverse_kernel(elements[i])


def se3_right_jacobian_inverse(xi: ArrayLike) -> Array:
    """Inverse right Jacobians (..., 6, 6) of twists (..., 6)."""
    elements, results = _flat(xi, (6,), (6, 6))
    _right_jacobian_inverse_batch(elements.reshape(-1, *(6,)), results.reshape(-1, *(6, 6)))
    return results


@njit(cache=True)
def _right_jacobian_inverse_batch(elements: Array, results: Array) -> None:
    for i in range(len(elements)):
        results[i] = right_jacobian_inverse_kernel(elements[i])


def _flat(
    argument: ArrayLike, element: tuple[int, ...], result: tuple[int, ...]
) -> tuple[Array, Array]:
    """The argument as an array, and room for one result for each of its elements."""
    array = np.ascontiguousarray(argument, np.float64)
    batch = array.ndim - len(element)
    if batch < 0 or array.shape[batch:] != element:
        expected = ", ".join(["...", *map(str, element)])
        raise ValueError(f"expected an array of shape ({expected}), not {array.shape}")
    return array, np.empty((*array.shape[:batch], *result))
