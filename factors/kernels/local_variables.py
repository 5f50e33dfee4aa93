"""Local variables of the trajectory around a state, their interpolation and their Jacobians.

Around state i the local variables of a state (T, v) are xi = Log(T_i^-1 T) and its rate w =
Jr(xi)^-1 v, in which the Gaussian process is linear. Section III-C of Wang and Gammell; Barfoot,
"State Estimation for Robotics", chapter 11. Everything here is for one element, inside numba code.
"""

from __future__ import annotations

import numpy as np

from factors.kernels.compiled import bare_kernel, inner_kernel, kernel
from factors.kernels.matrices import copy_kernel
from factors.kernels.se3 import (
    RIGHT,
    Array,
    adjoint_coefficients_kernel,
    compose_exp_kernel,
    first_stumpff_kernel,
    inverse_coefficients_kernel,
    jacobian_coefficients_kernel,
    log_and_inverse_kernel,
    multiply_kernel,
    polynomial_derivative_kernel,
    polynomial_product_kernel,
    relative_kernel,
    se3_polynomial_kernel,
)

EXACT, FIRST_ORDER = 1.0, 0.0


@inner_kernel
def local_state_kernel(T_i: Array, T_j: Array, v_j: Array) -> Array:
    """Compute the local variables (12,) of state j around state i.

    They are xi = Log(T_i^-1 T_j) and w = Jr(xi)^-1 v_j.
    """
    return local_of_relative_kernel(relative_kernel(T_i, T_j), v_j)[0]


@inner_kernel
def local_of_relative_kernel(T: Array, v_j: Array) -> tuple[Array, Array]:
    """Compute the same of T = T_i^-1 T_j, and p and q (3, 2) of Jr(xi)^-1."""
    xi, k = log_and_inverse_kernel(T)
    for n in range(3):
        k[n, 0] = -k[n, 0]  # of the right Jacobian
    w = polynomial_product_kernel(xi, k, v_j)
    local = np.empty(12)
    for i in range(6):
        local[i], local[6 + i] = xi[i], w[i]
    return local, k


@inner_kernel
def local_polynomials_kernel(
    local: Array, k: Array, v_j: Array, higher: float
) -> tuple[Array, Array, Array]:
    """Compute Jl(xi)^-1, Jr(xi)^-1, and the Jacobian of Jr(xi)^-1 v_j by xi, (6, 6) each.

    k are p and q (3, 2) of Jr(xi)^-1. `higher` weights the terms beyond first order in the last
    one, of v_j + ad(xi) v_j / 2 + ...: EXACT, or FIRST_ORDER for the paper's E_21 and E_23.
    """
    right = se3_polynomial_kernel(local, k)
    of_left, of_rate = k.copy(), k.copy()
    for n in range(3):
        of_left[n, 0] = -k[n, 0]
        of_rate[n, 1] *= higher
    left = se3_polynomial_kernel(local, of_left)
    return left, right, polynomial_derivative_kernel(local, of_rate, v_j)


@inner_kernel
def local_blocks_kernel(
    local: Array, k: Array, v_j: Array, higher: float
) -> tuple[Array, Array, Array, Array]:
    """Compute the Jacobians (6, 6) of xi and its rate: xi_i, xi_j, rate_i, rate_j.

    Those with suffix _i are with respect to -T_i, those with suffix _j with respect to T_j. The
    Jacobian of the rate with respect to v_j is xi_j. See `local_polynomials_kernel`.
    """
    left, right, rate_by_xi = local_polynomials_kernel(local, k, v_j, higher)
    return left, right, multiply_kernel(rate_by_xi, left), multiply_kernel(rate_by_xi, right)


@inner_kernel
def local_jacobian_kernel(local: Array, v_j: Array) -> Array:
    """Compute the Jacobian of the local variables with respect to T_i, v_i, T_j, v_j, (12, 24)."""
    k = inverse_coefficients_kernel(local, RIGHT)
    xi_i, xi_j, rate_i, rate_j = local_blocks_kernel(local, k, v_j, EXACT)
    jacobian = np.zeros((12, 24))
    for i in range(6):
        for j in range(6):
            jacobian[i, j] = -xi_i[i, j]
            jacobian[i, 12 + j] = xi_j[i, j]
            jacobian[6 + i, j] = -rate_i[i, j]
            jacobian[6 + i, 12 + j] = rate_j[i, j]
            jacobian[6 + i, 18 + j] = xi_j[i, j]
    return jacobian


@kernel
def wnoa_kernel(T_i: Array, v_i: Array, T_j: Array, v_j: Array, dt: float) -> Array:
    """Compute the Jacobian of the error (12, 24) and, as the last column, the error: (12, 25).

    The Jacobian is with respect to T_i, v_i, T_j, v_j.
    """
    local = local_state_kernel(T_i, T_j, v_j)
    result = np.zeros((12, 25))
    copy_kernel(local_jacobian_kernel(local, v_j), result)
    for i in range(6):
        result[i, 24] = local[i] - dt * v_i[i]
        result[6 + i, 24] = local[6 + i] - v_i[i]
        result[i, 6 + i] = -dt
        result[6 + i, 6 + i] = -1.0
    return result


@kernel
def hermite_weights(a: float, b: float) -> Array:
    """Compute the weights (2, 2, 2) of (xi, w) at the time a after state i and b before state j.

    The first matrix is Lambda, the weight of state i's local variables. The second is Omega, the
    weight of state j's.
    """
    weights = np.empty((2, 2, 2))
    write_hermite_weights(a, b, weights)
    return weights


@bare_kernel
def write_hermite_weights(a: float, b: float, weights: Array) -> None:
    """Write what `hermite_weights` returns."""
    dt = a + b
    s, r = a / dt, b / dt
    weights[0, 0, 0], weights[0, 0, 1] = r * r * (1 + 2 * s), r * r * a
    weights[0, 1, 0], weights[0, 1, 1] = -6 * s * r / dt, r * (1 - 3 * s)
    weights[1, 0, 0], weights[1, 0, 1] = s * s * (1 + 2 * r), -s * s * b
    weights[1, 1, 0], weights[1, 1, 1] = 6 * s * r / dt, s * (1 - 3 * r)


@inner_kernel
def interpolated_local_kernel(v_i: Array, local_j: Array, weights: Array) -> Array:
    """Interpolate the local variables (xi, w) around state i from those of both states, (12,)."""
    local = np.empty(12)
    write_interpolated_local(v_i, local_j, weights, local)
    return local


@bare_kernel
def write_interpolated_local(v_i: Array, local_j: Array, weights: Array, local: Array) -> None:
    """Write what `interpolated_local_kernel` returns."""
    for k in range(2):
        for n in range(6):
            local[6 * k + n] = (
                weights[0, k, 1] * v_i[n]
                + weights[1, k, 0] * local_j[n]
                + weights[1, k, 1] * local_j[6 + n]
            )


@inner_kernel
def retract_kernel(T_i: Array, local: Array, T: Array, v: Array) -> None:
    """Write the pose T_i Exp(xi) and the twist Jr(xi) w of local variables (xi, w) around T_i."""
    compose_exp_kernel(T_i, local, T)
    twist = polynomial_product_kernel(local, jacobian_coefficients_kernel(local, RIGHT), local[6:])
    for i in range(6):
        v[i] = twist[i]


@inner_kernel
def backward_adjoint_kernel(local: Array) -> Array:
    """Compute the Jacobian of T_i Exp(xi) with respect to T_i at fixed xi, (6, 6)."""
    return se3_polynomial_kernel(local, adjoint_coefficients_kernel(local, RIGHT))


@bare_kernel
def chain_rule_kernel(
    rows: Array, local: Array, by_states_j: Array, share: Array, result: Array
) -> None:
    """Write the Jacobians (3, 30) of errors with respect to both states (24) and to xi (6).

    The first 6 columns of rows are those with respect to the pose T_i Exp(xi). These are
    multiplied by Jr(xi) and by the adjoint of Exp(-xi), 1 + p W + q W^2, without making these
    matrices: p and q are numbers, and their dual parts times what the angle changes by.
    """
    s = local[0] * local[0] + local[1] * local[1] + local[2] * local[2]
    c_1, c_2, c_3, c_4, c_5 = first_stumpff_kernel(s)
    d_1, d_2, d_3 = 0.5 * (c_3 - c_2), 0.5 * (2 * c_4 - c_3), 0.5 * (3 * c_5 - c_4)  # by s
    ds = 2 * (local[0] * local[3] + local[1] * local[4] + local[2] * local[5])
    velocity, pose_j, rate_j = share[0, 0, 1], share[1, 0, 0], share[1, 0, 1]
    adjoint = -c_1, c_2, -ds * d_1, ds * d_2
    jacobian = -c_2, c_3, -ds * d_2, ds * d_3
    B = by_states_j
    for r in range(3):
        _polynomial_row_kernel(rows, r, local, *adjoint, result, 0)
        _polynomial_row_kernel(rows, r, local, *jacobian, result, 24)
        x, y, z = result[r, 24], result[r, 25], result[r, 26]
        u, v, w = result[r, 27], result[r, 28], result[r, 29]
        result[r, 6], result[r, 7], result[r, 8] = velocity * x, velocity * y, velocity * z
        result[r, 9], result[r, 10], result[r, 11] = velocity * u, velocity * v, velocity * w
        for j in range(12, 24):
            result[r, j] = 0.0
        for j in range(24):
            by_pose = x * B[0, j] + y * B[1, j] + z * B[2, j]
            by_pose += u * B[3, j] + v * B[4, j] + w * B[5, j]
            by_rate = x * B[6, j] + y * B[7, j] + z * B[8, j]
            by_rate += u * B[9, j] + v * B[10, j] + w * B[11, j]
            result[r, j] += pose_j * by_pose + rate_j * by_rate


@bare_kernel
def _polynomial_row_kernel(
    rows: Array,
    r: int,
    xi: Array,
    p: float,
    q: float,
    dp: float,
    dq: float,
    result: Array,
    first: int,
) -> None:
    """Write row r times the matrix 1 + p W + q W^2 of a twist to that of result, from `first` on.

    W is [[phi]x 0; [rho]x [phi]x], so that (a, b) W = (a x phi + b x rho, b x phi). dp and dq are
    the dual parts of p and q: the matrix has dp [phi]x + dq [phi]x^2 below the diagonal, too.
    """
    a, b = (rows[r, 0], rows[r, 1], rows[r, 2]), (rows[r, 3], rows[r, 4], rows[r, 5])
    phi, rho = (xi[0], xi[1], xi[2]), (xi[3], xi[4], xi[5])
    a_phi, b_phi, b_rho = _cross(a, phi), _cross(b, phi), _cross(b, rho)
    once = a_phi[0] + b_rho[0], a_phi[1] + b_rho[1], a_phi[2] + b_rho[2]
    b_phi_phi, once_phi, b_phi_rho = _cross(b_phi, phi), _cross(once, phi), _cross(b_phi, rho)
    for i in range(3):
        twice = once_phi[i] + b_phi_rho[i]
        result[r, first + i] = a[i] + p * once[i] + q * twice + dp * b_phi[i] + dq * b_phi_phi[i]
        result[r, first + 3 + i] = b[i] + p * b_phi[i] + q * b_phi_phi[i]


@inner_kernel
def _cross(
    x: tuple[float, float, float], y: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Cross product."""
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]
