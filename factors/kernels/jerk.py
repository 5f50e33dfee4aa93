"""Local variables of pose, twist and acceleration around a state, and their Jacobians.

Around state i the local variables of a state (T, v, a) are xi = Log(T_i^-1 T), its rate w =
Jr(xi)^-1 v and the rate of that, u = Jr(xi)^-1 a + (d Jr(xi)^-1 / dt) v, in which the Gaussian
process of white noise on jerk is linear (Tang, Yoon, Barfoot, "A white-noise-on-jerk motion prior
for continuous-time trajectory estimation on SE(3)", 2019, to first order; here exact).

Derivatives along w are complex steps, f(xi + i h w) = f(xi) + i h f'(xi) w: exact to rounding,
because nothing is subtracted (Squire and Trapp, 1998).
"""

from __future__ import annotations

import numpy as np

from factors.kernels.compiled import inner_kernel, kernel
from factors.kernels.local_variables import retract_kernel
from factors.kernels.se3 import (
    LEFT,
    RIGHT,
    Array,
    inverse_coefficients_kernel,
    jacobian_coefficients_kernel,
    log_kernel,
    polynomial_derivative_kernel,
    relative_kernel,
    se3_polynomial_kernel,
)

_STEP = 1e-30


@inner_kernel
def along_kernel(xi: Array, w: Array, v: Array) -> tuple[Array, Array]:
    """Compute derivatives along w of Jr(xi)^-1, and of the Jacobian of Jr(xi)^-1 v, (6, 6) each."""
    stepped, fixed = np.empty(6, np.complex128), np.empty(6, np.complex128)
    for i in range(6):
        stepped[i], fixed[i] = xi[i] + 1j * _STEP * w[i], v[i]
    k = inverse_coefficients_kernel(stepped, RIGHT)
    inverse = se3_polynomial_kernel(stepped, k)
    derivative = polynomial_derivative_kernel(stepped, k, fixed)
    first, second = np.empty((6, 6)), np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            first[i, j], second[i, j] = inverse[i, j].imag / _STEP, derivative[i, j].imag / _STEP
    return first, second


@inner_kernel
def _chain_kernel(by_inner: Array, inner: float, outer: float, jacobian: Array) -> None:
    """Add the derivatives (6, 6) by six rows of a Jacobian (n, 25) times these, to six others."""
    first, to = int(inner), int(outer)
    for i in range(6):
        for k in range(6):
            for j in range(18):
                jacobian[to + i, j] += by_inner[i, k] * jacobian[first + k, j]


@kernel
def local_motion_kernel(T_i: Array, T_j: Array, v_j: Array, a_j: Array) -> Array:
    """Compute the local variables xi, w, u and their Jacobian: (18, 25).

    The columns are T_i, T_j, v_j, a_j (6 each) and the variables themselves.
    """
    xi = log_kernel(relative_kernel(T_i, T_j))
    k = inverse_coefficients_kernel(xi, RIGHT)
    right = se3_polynomial_kernel(xi, k)
    left = se3_polynomial_kernel(xi, inverse_coefficients_kernel(xi, LEFT))
    w_by_xi = polynomial_derivative_kernel(xi, k, v_j)
    w = np.zeros(6)
    for i in range(6):
        for j in range(6):
            w[i] += right[i, j] * v_j[j]
    u_by_v, u_by_xi = along_kernel(xi, w, v_j)
    u_by_xi += polynomial_derivative_kernel(xi, k, a_j)
    result = np.zeros((18, 25))
    for i in range(6):
        for j in range(6):
            result[i, j], result[i, 6 + j] = -left[i, j], right[i, j]
            result[6 + i, 12 + j] = result[12 + i, 18 + j] = right[i, j]
            result[12 + i, 12 + j] = u_by_v[i, j]
    # w = Jr^-1 v and u = Jr^-1 a + (dw/dxi) w, both of xi: one chain rule after the other.
    _chain_kernel(w_by_xi, 0.0, 6.0, result)
    _chain_kernel(w_by_xi, 6.0, 12.0, result)
    _chain_kernel(u_by_xi, 0.0, 12.0, result)
    for i in range(6):
        result[i, 24], result[6 + i, 24] = xi[i], w[i]
        for j in range(6):
            result[12 + i, 24] += right[i, j] * a_j[j] + w_by_xi[i, j] * w[j]
    return result


@kernel
def wnoj_kernel(
    T_i: Array, v_i: Array, a_i: Array, T_j: Array, v_j: Array, a_j: Array, dt: float
) -> Array:
    """Compute the Jacobian of the error (18, 36) and, as the last column, the error: (18, 37).

    The Jacobian is with respect to T_i, v_i, a_i, T_j, v_j, a_j.
    """
    local = local_motion_kernel(T_i, T_j, v_j, a_j)
    result = np.zeros((18, 37))
    for i in range(18):
        for j in range(25):
            result[i, j if j < 6 else 12 + j] = local[i, j]
    for i in range(6):
        result[i, 6 + i] = result[6 + i, 12 + i] = -dt
        result[6 + i, 6 + i] = result[12 + i, 12 + i] = -1.0
        result[i, 12 + i] = -dt * dt / 2
        result[i, 36] -= dt * v_i[i] + dt * dt / 2 * a_i[i]
        result[6 + i, 36] -= v_i[i] + dt * a_i[i]
        result[12 + i, 36] -= a_i[i]
    return result


@kernel
def retract_motion_kernel(T_i: Array, local: Array, T: Array, v: Array, a: Array) -> None:
    """Write the pose, twist and acceleration of local variables (xi, w, u), (18,), around T_i."""
    retract_kernel(T_i, local[:12], T, v)
    xi = local[:6].copy()
    by_xi = polynomial_derivative_kernel(xi, inverse_coefficients_kernel(xi, RIGHT), v)
    jacobian = se3_polynomial_kernel(xi, jacobian_coefficients_kernel(xi, RIGHT))
    for i in range(6):
        a[i] = 0.0
        for k in range(6):
            rest = local[12 + k]
            for j in range(6):
                rest -= by_xi[k, j] * local[6 + j]
            a[i] += jacobian[i, k] * rest


@kernel
def quintic_weights(a: float, b: float) -> Array:
    """Compute the weights (2, 3, 3) of (xi, w, u) at the time a after state i and b before state j.

    The first matrix is the weight of state i's local variables, the second of state j's: those of
    quintic Hermite interpolation and its derivatives, which the process's mean is.
    """
    dt = a + b
    s, r = a / dt, b / dt
    weights = np.empty((2, 3, 3))
    for end in range(2):
        x, y, sign = (s, r, 1.0) if end == 0 else (r, s, -1.0)
        # Of the end that is x away, y from the other; odd derivatives change sign with time.
        W = weights[end]
        W[0, 0] = y * y * y * (1 + 3 * x + 6 * x * x)
        W[0, 1] = sign * dt * x * y * y * y * (1 + 3 * x)
        W[0, 2] = dt * dt / 2 * x * x * y * y * y
        W[1, 0] = -sign * 30 * x * x * y * y / dt
        W[1, 1] = y * y * (1 + 2 * x - 15 * x * x)
        W[1, 2] = sign * dt / 2 * x * y * y * (2 - 5 * x)
        W[2, 0] = -60 * x * y * (1 - 2 * x) / (dt * dt)
        W[2, 1] = sign * 12 * x * y * (5 * x - 3) / dt
        W[2, 2] = y * (1 - 8 * x + 10 * x * x)
    return weights
