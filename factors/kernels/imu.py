"""Error of preintegrated inertial measurements between two states with body twists.

With R, p of T_i in the frame of T_j, what is preintegrated (theta, P, V), the linear velocities v,
and gravity g in the frame of T_j, the prediction of state j is off by the element of SE_2(3)

    E = R Exp(theta),  p + R (P + dt v_i) + dt^2 g / 2,  R (V + v_i) + dt g - v_j

and the error is its logarithm: those of (E, position) and of (E, velocity) in SE(3), which have the
rotation in common. Forster, Carlone, Dellaert, Scaramuzza, "On-manifold preintegration", 2017.
"""

from __future__ import annotations

import numpy as np

from factors.kernels.compiled import inner_kernel, kernel
from factors.kernels.outputs import Addresses, error_at, jacobian_at
from factors.kernels.se3 import (
    RIGHT,
    Array,
    exp_kernel,
    jacobian_coefficients_kernel,
    log_and_inverse_kernel,
    relative_kernel,
    se3_polynomial_kernel,
)


@inner_kernel
def _turned_back_kernel(A: Array, first: int, R: Array) -> Array:
    """Compute the three rows from `first` on, and three columns, of A times the transpose of R."""
    C = np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            for j in range(3):
                C[i, j] += A[first + i, k] * R[j, k]
    return C


@inner_kernel
def _write_cross_kernel(A: Array, first: int, B: Array, x: Array, sign: float, to: Array) -> None:
    """Write sign * (A - B [x]x) to three rows from `first` on, of A the last three rows."""
    last = len(A) - 3
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            to[first + i, j] = sign * (A[last + i, j] - B[i, a] * x[b] + B[i, b] * x[a])


@kernel
def imu_kernel(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    bias: Array,
    constants: Array,
    outputs: Addresses,
) -> None:
    """Write the error (9,), rotation, position, velocity, and its Jacobians (9, 6).

    The constants are dt, gravity (3,), what is preintegrated (9,) without bias, and the Jacobian
    (9, 6) of this by the bias. Jacobians are zero where nothing is written.
    """
    dt, g, pre = constants[0], constants[1:4], constants[4:13].copy()
    by_bias = constants[13:].reshape(9, 6)
    for n in range(9):
        for k in range(6):
            pre[n] += by_bias[n, k] * bias[k]
    theta, P, V = np.zeros(6), np.empty(3), np.empty(3)
    for n in range(3):
        theta[n], P[n], V[n] = pre[n], pre[3 + n] + dt * v_i[3 + n], pre[6 + n] + v_i[3 + n]
    between, turn = relative_kernel(T_j, T_i), exp_kernel(theta)
    moved = between.copy()
    for i in range(3):
        down = T_j[0, i] * g[0] + T_j[1, i] * g[1] + T_j[2, i] * g[2]
        moved[i, 3] += dt * dt / 2 * down
        for j in range(3):
            moved[i, 3] += between[i, j] * P[j]
            moved[i, j] = 0.0
            for k in range(3):
                moved[i, j] += between[i, k] * turn[k, j]
    xi, k = log_and_inverse_kernel(moved)
    left, xi_v = se3_polynomial_kernel(xi, k), xi.copy()
    off = np.empty(3)
    for i in range(3):
        off[i] = dt * (T_j[0, i] * g[0] + T_j[1, i] * g[1] + T_j[2, i] * g[2]) - v_j[3 + i]
        for j in range(3):
            off[i] += between[i, j] * V[j]
    for i in range(3):  # the logarithm moves by Jl^-1
        xi_v[3 + i] = left[i, 0] * off[0] + left[i, 1] * off[1] + left[i, 2] * off[2]
    left_v = se3_polynomial_kernel(xi_v, k)
    for n in range(3):
        k[n, 0] = -k[n, 0]
    right, right_v = se3_polynomial_kernel(xi, k), se3_polynomial_kernel(xi_v, k)
    error = error_at(outputs, 9)
    for i in range(3):
        error[i], error[3 + i], error[6 + i] = xi[i], xi[3 + i], xi_v[3 + i]
    moving = _turned_back_kernel(right, 0, turn)
    _write_first(moving, right, right_v, turn, P, V, dt, outputs)
    _write_second(left, left_v, v_j, outputs)
    jacobian = se3_polynomial_kernel(theta, jacobian_coefficients_kernel(theta, RIGHT))
    _write_bias(moving, right, right_v, jacobian, by_bias, jacobian_at(outputs, 4, 9, 6))


@inner_kernel
def _write_first(
    moving: Array,
    right: Array,
    right_v: Array,
    turn: Array,
    P: Array,
    V: Array,
    dt: float,
    outputs: Addresses,
) -> None:
    """Write the Jacobians by T_i and v_i."""
    by_pose, by_twist = jacobian_at(outputs, 0, 9, 6), jacobian_at(outputs, 1, 9, 6)
    _write_cross_kernel(_turned_back_kernel(right, 3, turn), 3, moving, P, 1.0, by_pose)
    _write_cross_kernel(_turned_back_kernel(right_v, 3, turn), 6, moving, V, 1.0, by_pose)
    for i in range(3):
        for j in range(3):
            by_pose[i, j] = by_pose[3 + i, 3 + j] = by_twist[6 + i, 3 + j] = moving[i, j]
            by_twist[3 + i, 3 + j] = dt * moving[i, j]


@inner_kernel
def _write_second(left: Array, left_v: Array, v_j: Array, outputs: Addresses) -> None:
    """Write the Jacobians by T_j and v_j."""
    by_pose, by_twist = jacobian_at(outputs, 2, 9, 6), jacobian_at(outputs, 3, 9, 6)
    _write_cross_kernel(left_v, 6, left, v_j[3:], -1.0, by_pose)
    for i in range(3):
        for j in range(3):
            by_pose[i, j] = by_pose[3 + i, 3 + j] = by_twist[6 + i, 3 + j] = -left[i, j]
            by_pose[3 + i, j] = -left[3 + i, j]


@inner_kernel
def _write_bias(
    moving: Array, right: Array, right_v: Array, jacobian: Array, by_bias: Array, result: Array
) -> None:
    """Write the Jacobian by the bias: it moves what is preintegrated."""
    for j in range(6):
        for i in range(3):
            turned = 0.0
            for k in range(3):
                turned += jacobian[i, k] * by_bias[k, j]
            result[i, j] = turned
        x, y, z = result[0, j], result[1, j], result[2, j]
        for i in range(3):
            result[i, j] = right[i, 0] * x + right[i, 1] * y + right[i, 2] * z
            position = right[3 + i, 0] * x + right[3 + i, 1] * y + right[3 + i, 2] * z
            velocity = right_v[3 + i, 0] * x + right_v[3 + i, 1] * y + right_v[3 + i, 2] * z
            for k in range(3):
                position += moving[i, k] * by_bias[3 + k, j]
                velocity += moving[i, k] * by_bias[6 + k, j]
            result[3 + i, j], result[6 + i, j] = position, velocity
