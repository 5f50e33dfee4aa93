"""Kernels of SE(3) for one element at a time, inside numba code.

A 6 x 6 adjoint [[A, 0], [B, A]] of a twist or transform is the matrix A + eps B of dual numbers,
eps^2 = 0, so that each formula of SO(3) holds on SE(3) once its numbers are dual (Study; Barfoot,
"State Estimation for Robotics", chapter 7, writes the dual parts out). With the dual rotation
vector xi = phi + eps rho and W its cross product matrix, the adjoint of Exp(xi), both Jacobians and
their inverses are 1 + p W + q W^2, where p and q depend only on the squared angle s.

Arrays are C-contiguous float64, because numba would compile a kernel again for another layout, and
kernels take no integers, because it would for each literal one.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import bare_kernel, inner_kernel

Array = NDArray[np.float64]

LEFT, RIGHT = 1.0, -1.0  # the right Jacobian is the left one of -xi, which has -p

_SERIES_TERMS = 14  # the last term is 1e-17 of the first at an angle of pi
_SERIES_LIMIT = 10.0  # squared angle, a little above pi^2
_SMALL_TERMS, _SMALL_LIMIT = 6, 0.1  # as good at an angle of 0.3
_INVERSE_FACTORIAL = np.array([1 / factorial(n) for n in range(2 * _SERIES_TERMS + 9)])


@inner_kernel
def stumpff_kernel(s: float) -> Array:
    """Compute the Stumpff functions c_n(s), n = 0..8, and two derivatives, (3, 9).

    c_n(s) = sum_m (-s)^m / (2m + n)!. With s = w^2, c_0..c_3 are cos w, sin(w)/w, (1 - cos w)/w^2
    and (w - sin w)/w^3 of the angle w. The derivatives of the last columns stay zero.
    """
    c = np.full((3, 9), 0 * s)  # of the type of s, complex for complex steps
    if s.real < _SERIES_LIMIT:
        c[0, 7], c[0, 8] = _series_kernel(s)
        for n in range(6, -1, -1):
            c[0, n] = _INVERSE_FACTORIAL[n] - s * c[0, n + 2]
    else:
        w = np.sqrt(s)
        c[0, 0], c[0, 1] = np.cos(w), np.sin(w) / w
        for n in range(7):
            c[0, n + 2] = (_INVERSE_FACTORIAL[n] - c[0, n]) / s
    for k in range(2):
        for n in range(7 - 2 * k):
            c[k + 1, n] = 0.5 * (n * c[k, n + 2] - c[k, n + 1])
    return c


@bare_kernel
def _series_kernel(s: float) -> tuple[float, float]:
    """Compute c_7 and c_8 of the Stumpff functions."""
    odd, even = 0 * s, 0 * s
    for m in range((_SMALL_TERMS if s.real < _SMALL_LIMIT else _SERIES_TERMS) - 1, -1, -1):
        odd = _INVERSE_FACTORIAL[2 * m + 7] - s * odd
        even = _INVERSE_FACTORIAL[2 * m + 8] - s * even
    return odd, even


@bare_kernel
def first_stumpff_kernel(s: float) -> tuple[float, float, float, float, float]:
    """Compute c_1 to c_5 of the Stumpff functions, without an array."""
    f = _INVERSE_FACTORIAL
    if s < _SERIES_LIMIT:
        c_7, c_8 = _series_kernel(s)
        c_5, c_4 = f[5] - s * c_7, f[4] - s * (f[6] - s * c_8)
        c_3 = f[3] - s * c_5
        return 1 - s * c_3, f[2] - s * c_4, c_3, c_4, c_5
    w = np.sqrt(s)
    c_1, c_2 = np.sin(w) / w, (1 - np.cos(w)) / s
    c_3 = (1 - c_1) / s
    return c_1, c_2, c_3, (f[2] - c_2) / s, (f[3] - c_3) / s


@inner_kernel
def jacobian_coefficients_kernel(xi: Array, side: float) -> Array:
    """Compute p and q of the Jacobian and two derivatives with respect to s, (3, 2).

    `side` is LEFT or RIGHT.
    """
    c = stumpff_kernel(xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2])
    k = np.empty((3, 2), xi.dtype)
    for n in range(3):
        k[n, 0], k[n, 1] = side * c[n, 2], c[n, 3]
    return k


@inner_kernel
def inverse_coefficients_kernel(xi: Array, side: float) -> Array:
    """Compute p and q of the inverse Jacobian and two derivatives with respect to s, (3, 2)."""
    c = stumpff_kernel(xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2])
    k = np.zeros((3, 2), xi.dtype)
    k[0, 0] = -0.5 * side
    half = 2 * c[0, 2]
    q = (c[0, 3] - 2 * c[0, 4]) / half
    slope = (c[1, 3] - 2 * c[1, 4]) / half + q * q
    k[0, 1], k[1, 1] = q, slope
    k[2, 1] = (c[2, 3] - 2 * c[2, 4]) / half + 3 * q * slope - q * q * q
    return k


@inner_kernel
def adjoint_coefficients_kernel(xi: Array, side: float) -> Array:
    """Compute p and q of the adjoint and two derivatives with respect to s, (3, 2).

    The adjoint is that of Exp(xi) if `side` is LEFT, and of Exp(-xi) if it is RIGHT.
    """
    c = stumpff_kernel(xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2])
    k = np.empty((3, 2))
    for n in range(3):
        k[n, 0], k[n, 1] = side * c[n, 1], c[n, 2]
    return k


@inner_kernel
def se3_polynomial_kernel(xi: Array, k: Array) -> Array:
    """Compute 1 + p W + q W^2 (6, 6) of a twist on dual numbers, with W^2 = phi phi^T - s."""
    p, q = k[0, 0], k[0, 1]
    s = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]
    ds = 2 * (xi[0] * xi[3] + xi[1] * xi[4] + xi[2] * xi[5])
    dp, dq = ds * k[1, 0], ds * k[1, 1]
    M = np.zeros((6, 6), xi.dtype)
    for i in range(3):
        for j in range(3):
            M[i, j] = q * xi[i] * xi[j]
            M[3 + i, j] = q * (xi[3 + i] * xi[j] + xi[i] * xi[3 + j]) + dq * xi[i] * xi[j]
        M[i, i] += 1 - q * s
        M[3 + i, i] -= q * ds + dq * s
    _add_cross_kernel(M, p, dp, xi)
    return M


@inner_kernel
def _dual_parts_kernel(xi: Array, w: Array) -> tuple[Array, Array]:
    """Compute W w and W^2 w on dual numbers, (6,) each: W^2 w = phi (phi . w) - s w."""
    s = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]
    ds = 2 * (xi[0] * xi[3] + xi[1] * xi[4] + xi[2] * xi[5])
    dot = xi[0] * w[0] + xi[1] * w[1] + xi[2] * w[2]
    ddot = xi[0] * w[3] + xi[1] * w[4] + xi[2] * w[5] + xi[3] * w[0] + xi[4] * w[1] + xi[5] * w[2]
    once, twice = np.empty(6, xi.dtype), np.empty(6, xi.dtype)
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        once[i] = xi[a] * w[b] - xi[b] * w[a]
        once[3 + i] = xi[a] * w[3 + b] - xi[b] * w[3 + a] + xi[3 + a] * w[b] - xi[3 + b] * w[a]
        twice[i] = xi[i] * dot - s * w[i]
        twice[3 + i] = xi[i] * ddot + xi[3 + i] * dot - s * w[3 + i] - ds * w[i]
    return once, twice


@inner_kernel
def polynomial_product_kernel(xi: Array, k: Array, w: Array) -> Array:
    """Compute (1 + p W + q W^2) w (6,) on dual numbers; names that start with d are dual parts."""
    ds = 2 * (xi[0] * xi[3] + xi[1] * xi[4] + xi[2] * xi[5])
    p, q, dp, dq = k[0, 0], k[0, 1], ds * k[1, 0], ds * k[1, 1]
    once, twice = _dual_parts_kernel(xi, w)
    result = np.empty(6)
    for i in range(3):
        result[i] = w[i] + p * once[i] + q * twice[i]
        result[3 + i] = w[3 + i] + p * once[3 + i] + q * twice[3 + i]
        result[3 + i] += dp * once[i] + dq * twice[i]
    return result


@inner_kernel
def polynomial_derivative_kernel(xi: Array, k: Array, w: Array) -> Array:
    """Compute the Jacobian of (1 + p W + q W^2) w with respect to xi at fixed w (6,), (6, 6).

    On SO(3) it is -p [w] + q (phi.w + phi w^T - 2 w phi^T) + 2 (p' phi x w + q' W^2 w) phi^T. Here
    the same formula is evaluated on dual numbers; names that start with d are dual parts.
    """
    ds = 2 * (xi[0] * xi[3] + xi[1] * xi[4] + xi[2] * xi[5])
    dot = xi[0] * w[0] + xi[1] * w[1] + xi[2] * w[2]
    ddot = xi[0] * w[3] + xi[1] * w[4] + xi[2] * w[5] + xi[3] * w[0] + xi[4] * w[1] + xi[5] * w[2]
    p, q, dp, dq = k[0, 0], k[0, 1], ds * k[1, 0], ds * k[1, 1]
    once, twice = _dual_parts_kernel(xi, w)
    D = np.zeros((6, 6), xi.dtype)
    for i in range(3):
        u = k[1, 0] * once[i] + k[1, 1] * twice[i]
        du = k[1, 0] * once[3 + i] + k[1, 1] * twice[3 + i]
        du += ds * (k[2, 0] * once[i] + k[2, 1] * twice[i])
        for j in range(3):
            outer = xi[i] * w[j] - 2 * w[i] * xi[j]
            douter = xi[i] * w[3 + j] - 2 * w[3 + i] * xi[j]
            douter += xi[3 + i] * w[j] - 2 * w[i] * xi[3 + j]
            D[i, j] = q * outer + 2 * u * xi[j]
            D[3 + i, j] = q * douter + dq * outer + 2 * (du * xi[j] + u * xi[3 + j])
        D[i, i] += q * dot
        D[3 + i, i] += q * ddot + dq * dot
    _add_cross_kernel(D, -p, -dp, w)
    return D


@bare_kernel
def _add_cross_kernel(M: Array, p: float, dp: float, x: Array) -> None:
    """Add p + eps dp times the cross product matrix of x, and copy the upper block to the lower."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        M[k, j] += p * x[i]
        M[j, k] -= p * x[i]
        M[3 + k, j] += p * x[3 + i] + dp * x[i]
        M[3 + j, k] -= p * x[3 + i] + dp * x[i]
    for i in range(3):
        for j in range(3):
            M[3 + i, 3 + j] = M[i, j]


@inner_kernel
def exp_kernel(xi: Array) -> Array:
    """Compute the transform (4, 4) of a twist."""
    T = np.empty((4, 4))
    compose_exp_kernel(np.eye(4), xi, T)
    return T


@bare_kernel
def compose_exp_kernel(T_i: Array, xi: Array, T: Array) -> None:
    """Write the transform T = T_i Exp(xi), (4, 4).

    Exp(xi) turns by 1 + c_1 W + c_2 W^2 and moves by (1 + c_2 W + c_3 W^2) rho, W = [phi]x.
    """
    x, y, z, u, v, w = xi[0], xi[1], xi[2], xi[3], xi[4], xi[5]
    s, dot = x * x + y * y + z * z, x * u + y * v + z * w
    c_1, c_2, c_3, _, _ = first_stumpff_kernel(s)
    turn, move = 1 - c_2 * s, 1 - c_3 * s
    for i in range(3):
        a, b, c = T_i[i, 0], T_i[i, 1], T_i[i, 2]
        along = c_2 * (a * x + b * y + c * z)
        T[i, 0] = turn * a + along * x + c_1 * (b * z - c * y)
        T[i, 1] = turn * b + along * y + c_1 * (c * x - a * z)
        T[i, 2] = turn * c + along * z + c_1 * (a * y - b * x)
        moved = move * (a * u + b * v + c * w) + c_3 * dot * (a * x + b * y + c * z)
        moved += c_2 * (a * (y * w - z * v) + b * (z * u - x * w) + c * (x * v - y * u))
        T[i, 3] = T_i[i, 3] + moved
        T[3, i] = 0.0
    T[3, 3] = 1.0


@inner_kernel
def log_kernel(T: Array) -> Array:
    """Compute the twist (6,) of a transform, rotation angle at most pi."""
    return log_and_inverse_kernel(T)[0]


@inner_kernel
def log_and_inverse_kernel(T: Array) -> tuple[Array, Array]:
    """Compute the twist (6,) of a transform, and p and q (3, 2) of its inverse left Jacobian."""
    xi = np.zeros(6)
    _rotation_log(T, xi)
    k = inverse_coefficients_kernel(xi, LEFT)
    q, x, y, z, a, b, c = k[0, 1], xi[0], xi[1], xi[2], T[0, 3], T[1, 3], T[2, 3]
    stay, along = 1 - q * (x * x + y * y + z * z), q * (x * a + y * b + z * c)
    xi[3] = stay * a + along * x - 0.5 * (y * c - z * b)
    xi[4] = stay * b + along * y - 0.5 * (z * a - x * c)
    xi[5] = stay * c + along * z - 0.5 * (x * b - y * a)
    return xi, k


@inner_kernel
def _rotation_log(T: Array, xi: Array) -> None:
    """Write the rotation vector to xi[:3], by the largest quaternion component (Shepperd)."""
    trace = T[0, 0] + T[1, 1] + T[2, 2]
    q = np.empty(4)  # x, y, z, w
    i = 0
    for n in range(1, 3):
        if T[n, n] > T[i, i]:
            i = n
    j, k = (i + 1) % 3, (i + 2) % 3
    if trace > T[i, i]:
        q[3] = 1 + trace
        q[i], q[j], q[k] = T[k, j] - T[j, k], T[i, k] - T[k, i], T[j, i] - T[i, j]
    else:
        q[i] = 1 - trace + 2 * T[i, i]
        q[j], q[k] = T[i, j] + T[j, i], T[i, k] + T[k, i]
        q[3] = T[k, j] - T[j, k]
    size = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    scale = 2 / q[3]
    if size > 1e-12 * abs(q[3]):
        scale = 2 * np.arctan2(size, abs(q[3])) / size
        if q[3] < 0:
            scale = -scale
    for n in range(3):
        xi[n] = scale * q[n]


@inner_kernel
def relative_kernel(T_i: Array, T_j: Array) -> Array:
    """Compute the transform T_i^-1 T_j, (4, 4)."""
    T = np.zeros((4, 4))
    for i in range(3):
        for k in range(3):
            for j in range(3):
                T[i, j] += T_i[k, i] * T_j[k, j]
            T[i, 3] += T_i[k, i] * (T_j[k, 3] - T_i[k, 3])
    T[3, 3] = 1.0
    return T


@inner_kernel
def multiply_kernel(A: Array, B: Array) -> Array:
    """Multiply two matrices (6, 6) of the form [[A, 0], [B, A]], the dual number A + eps B."""
    C = np.zeros((6, 6))
    for i in range(3):
        for k in range(3):
            for j in range(3):
                C[i, j] += A[i, k] * B[k, j]
                C[3 + i, j] += A[3 + i, k] * B[k, j] + A[i, k] * B[3 + k, j]
    for i in range(3):
        for j in range(3):
            C[3 + i, 3 + j] = C[i, j]
    return C
