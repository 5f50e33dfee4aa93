"""The state between two others, its Jacobian, and what a measurement there tells of both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import inner_kernel, kernel
from factors.kernels.local_variables import (
    EXACT,
    backward_adjoint_kernel,
    hermite_weights,
    interpolated_local_kernel,
    local_jacobian_kernel,
    local_of_relative_kernel,
    local_polynomials_kernel,
    local_state_kernel,
    retract_kernel,
    wnoa_kernel,
)
from factors.kernels.matrices import product_kernel
from factors.kernels.outputs import Addresses, jacobian_at
from factors.kernels.se3 import (
    RIGHT,
    Array,
    jacobian_coefficients_kernel,
    log_kernel,
    polynomial_derivative_kernel,
    relative_kernel,
    se3_polynomial_kernel,
)
from factors.kernels.triangular import factorize_kernel, solve_lower_kernel

Index = NDArray[np.int64]

POSE_ONLY = np.array([0, -1])
"""Places of the pose and the twist, see `whiten_between_kernel`."""


@inner_kernel
def state_by_local_kernel(local: Array) -> Array:
    """Compute the Jacobian (12, 12) of the pose T_i Exp(xi) and the twist Jr(xi) w by (xi, w)."""
    k = jacobian_coefficients_kernel(local, RIGHT)
    jacobian, result = se3_polynomial_kernel(local, k), np.zeros((12, 12))
    turning = polynomial_derivative_kernel(local, k, local[6:])
    for i in range(6):
        for j in range(6):
            result[i, j] = result[6 + i, 6 + j] = jacobian[i, j]
            result[6 + i, j] = turning[i, j]
    return result


@inner_kernel
def retracted_jacobian_kernel(local: Array, by_local: Array) -> Array:
    """Compute the Jacobian of the pose T_i Exp(xi) and the twist Jr(xi) w, (12, n).

    `by_local` (12, n) is that of (xi, w), and the first six of the n columns are T_i's.
    """
    result = product_kernel(state_by_local_kernel(local), by_local)
    adjoint = backward_adjoint_kernel(local)
    for i in range(6):
        for j in range(6):
            result[i, j] += adjoint[i, j]
    return result


@kernel
def state_between_kernel(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: float, b: float, T: Array, v: Array
) -> Array:
    """Write the pose and the twist at the time a after state i and b before state j.

    Returned is their Jacobian (12, 24) with respect to T_i, v_i, T_j, v_j.
    """
    weights = hermite_weights(a, b)
    local_j = local_state_kernel(T_i, T_j, v_j)
    local = interpolated_local_kernel(v_i, local_j, weights)
    retract_kernel(T_i, local, T, v)
    by_states = interpolated_jacobian_kernel(local_jacobian_kernel(local_j, v_j), weights)
    return retracted_jacobian_kernel(local, by_states)


@inner_kernel
def interpolated_jacobian_kernel(by_states_j: Array, weights: Array) -> Array:
    """Compute the Jacobian (12, 24) of interpolated local variables from that of state j's."""
    result = np.empty((12, 24))
    for k in range(2):
        for i in range(6):
            for j in range(24):
                result[6 * k + i, j] = (
                    weights[1, k, 0] * by_states_j[i, j] + weights[1, k, 1] * by_states_j[6 + i, j]
                )
            result[6 * k + i, 6 + i] += weights[0, k, 1]
    return result


@kernel
def extrapolated_jacobian_kernel(v: Array, dt: float) -> Array:
    """Compute the Jacobian of the state dt seconds after (T, v) at constant twist, (12, 12)."""
    local, by_local = np.empty(12), np.zeros((12, 12))
    for i in range(6):
        local[i], local[6 + i] = dt * v[i], v[i]
        by_local[i, 6 + i], by_local[6 + i, 6 + i] = dt, 1.0
    return retracted_jacobian_kernel(local, by_local)


@inner_kernel
def between_kernel(T_i: Array, v_i: Array, T_j: Array, v_j: Array, t: Array, found: Array) -> None:
    """Write the state at the time t[0] after state i and t[1] before state j to `found` (48,).

    That is the twist and the first three rows of the pose; and what `chain_kernel` needs: the local
    variables of state j, p and q (3, 2) of their Jr(xi)^-1, and the local variables at t.
    """
    T = np.empty((4, 4))
    local_j, inverse = local_of_relative_kernel(relative_kernel(T_i, T_j), v_j)
    local = interpolated_local_kernel(v_i, local_j, hermite_weights(t[0], t[1]))
    retract_kernel(T_i, local, T, found[:6])
    for i in range(3):
        found[30 + 2 * i], found[31 + 2 * i] = inverse[i, 0], inverse[i, 1]
        for j in range(4):
            found[6 + 4 * i + j] = T[i, j]
    for i in range(12):
        found[18 + i], found[36 + i] = local_j[i], local[i]


@kernel
def state_at_kernel(T_i: Array, v_i: Array, T_j: Array, v_j: Array, t: Array, found: Array) -> None:
    """Do the same, and write the logarithm of the pose behind it, (54,)."""
    between_kernel(T_i, v_i, T_j, v_j, t, found)
    log = log_kernel(found[6:18].reshape(3, 4))
    for i in range(6):
        found[48 + i] = log[i]


@kernel
def chain_kernel(
    v_j: Array, t: Array, found: Array, by_pose: Array, by_twist: Array, outputs: Addresses
) -> None:
    """Write the Jacobians (m, 6) by both ends of m errors at the time t.

    `found` is of `between_kernel`; `by_pose` and `by_twist` (6, m), or (0, m), are their transposed
    Jacobians by the pose and the twist at t.
    """
    m, pose, twist = by_pose.shape[1], len(by_pose) > 0, len(by_twist) > 0
    by_T_i, by_v_i = jacobian_at(outputs, 0, m, 6), jacobian_at(outputs, 1, m, 6)
    by_T_j, by_v_j = jacobian_at(outputs, 2, m, 6), jacobian_at(outputs, 3, m, 6)
    share = hermite_weights(t[0], t[1])
    local_j, inverse, local = found[18:30], found[30:36].reshape(3, 2), found[36:48]
    left, right, rate_by_xi = local_polynomials_kernel(local_j, inverse, v_j, EXACT)
    k = jacobian_coefficients_kernel(local, RIGHT)
    jacobian, adjoint = se3_polynomial_kernel(local, k), backward_adjoint_kernel(local)
    turning = jacobian  # of the twist alone
    if twist:
        turning = polynomial_derivative_kernel(local, k, local[6:])
    by_xi, by_rate = np.empty(6), np.empty(6)  # of state j
    for r in range(m):
        for j in range(6):
            direct, x, w = 0.0, 0.0, 0.0
            for n in range(6):
                if pose:
                    direct += by_pose[n, r] * adjoint[n, j]
                    x += by_pose[n, r] * jacobian[n, j]
                if twist:
                    x += by_twist[n, r] * turning[n, j]
                    w += by_twist[n, r] * jacobian[n, j]
            by_T_i[r, j], by_v_i[r, j] = direct, share[0, 0, 1] * x + share[0, 1, 1] * w
            by_xi[j] = share[1, 0, 0] * x + share[1, 1, 0] * w
            by_rate[j] = share[1, 0, 1] * x + share[1, 1, 1] * w
        for j in range(6):
            for n in range(6):
                by_xi[j] += by_rate[n] * rate_by_xi[n, j]
        for j in range(6):
            from_i, pose_j, rate_j = 0.0, 0.0, 0.0
            for n in range(6):
                from_i += by_xi[n] * left[n, j]
                pose_j += by_xi[n] * right[n, j]
                rate_j += by_rate[n] * right[n, j]
            by_T_i[r, j] -= from_i
            by_T_j[r, j], by_v_j[r, j] = pose_j, rate_j


@kernel
def information_between_kernel(
    T_i: Array, v_i: Array, T: Array, v: Array, T_j: Array, v_j: Array, t: Array, W: Array
) -> Array:
    """Compute the information (12, 12) on a state (T, v), given those t[0] before and t[1] after.

    W (6, 6) is the lower triangular root of the inverse power spectral density.
    """
    before = wnoa_kernel(T_i, v_i, T, v, t[0])[:, 12:24]
    after = wnoa_kernel(T, v, T_j, v_j, t[1])[:, :12]
    information, line = np.zeros((12, 12)), np.empty((2, 12))
    for dt, J in ((t[0], before), (t[1], after)):
        a, b, c = np.sqrt(12 / dt**3), -np.sqrt(3 / dt), np.sqrt(1 / dt)
        for i in range(6):
            for j in range(12):
                top, bottom = 0.0, 0.0
                for k in range(i + 1):
                    top += W[i, k] * J[k, j]
                    bottom += W[i, k] * J[6 + k, j]
                line[0, j], line[1, j] = a * top + b * bottom, c * bottom
            for j in range(12):
                for k in range(12):
                    information[j, k] += line[0, j] * line[0, k] + line[1, j] * line[1, k]
    return information


@kernel
def whiten_between_kernel(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    t: Array,
    covariance: Array,
    W: Array,
    places: Index,
    found: Array,
    system: Array,
) -> None:
    """Whiten Jacobians and error (m, n + 1) at the time t, in place.

    Their covariance (m, m) is increased by that of the state between, given both ends. `places` are
    the first columns of the pose and of the twist at t, -1 if there is none.
    """
    m, T, v = len(system), found[6:18].reshape(3, 4), found[:6]
    total = covariance.copy()
    if t[0] > 0 and t[1] > 0:
        root = information_between_kernel(T_i, v_i, T, v, T_j, v_j, t, W)
        factorize_kernel(root)
        spread = np.zeros((12, m))
        for half in range(2):
            if places[half] >= 0:
                for i in range(6):
                    for r in range(m):
                        spread[6 * half + i, r] = system[r, places[half] + i]
        solve_lower_kernel(root, spread)
        for i in range(m):
            for j in range(m):
                for k in range(12):
                    total[i, j] += spread[k, i] * spread[k, j]
    factorize_kernel(total)
    solve_lower_kernel(total, system)
