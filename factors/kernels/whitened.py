"""Whitened errors of motion priors and their Jacobians, in SE(3) and the spaces within it.

`places` tell where a space is in SE(3): its rates are these columns of a twist, (n,), and then its
poses, which are matrices, are these rows and columns of a transform.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import inner_kernel, kernel
from factors.kernels.jerk import wnoj_kernel
from factors.kernels.local_variables import (
    local_blocks_kernel,
    local_of_relative_kernel,
)
from factors.kernels.outputs import Addresses, error_at, jacobian_at
from factors.kernels.se3 import Array, relative_kernel

Index = NDArray[np.uint64]  # numba looks whether signed ones are negative


@inner_kernel
def _transform_kernel(pose: Array, places: Index, n: int) -> Array:
    """Compute the transform (4, 4) of a pose whose rates are (n,)."""
    T = np.zeros((4, 4))
    for i in range(4):
        T[i, i] = 1.0
    for i in range(len(pose)):
        for j in range(len(pose)):
            T[places[n + i], places[n + j]] = pose[i, j]
    return T


@inner_kernel
def _twist_kernel(rate: Array, places: Index) -> Array:
    """Compute the twist (6,) of rates (n,)."""
    twist = np.zeros(6)
    for i in range(len(rate)):
        twist[places[i]] = rate[i]
    return twist


@kernel
def whitened_wnoa_kernel(
    pose_i: Array,
    v_i: Array,
    pose_j: Array,
    v_j: Array,
    places: Index,
    constants: Array,
    derivatives: bool,
    outputs: Addresses,
) -> None:
    """Write the whitened error (2 n,) and its Jacobians (2 n, n).

    The error is whitened by the Kronecker product of [[a, b], [0, c]] and a lower triangular W (n,
    n). The constants are dt, a, b, c, the weight of Jacobians beyond first order, whether W is
    diagonal, W, and the mean acceleration (n,).
    """
    n = len(v_i)
    dt, a, b, c = constants[0], constants[1], constants[2], constants[3]
    higher, diagonal, W = constants[4], constants[5] > 0, constants[6:-n].reshape(n, n)
    mean, twist_j, error = constants[-n:], v_j, error_at(outputs, 2 * n)
    if n == 6:
        T = relative_kernel(pose_i, pose_j)
    else:
        twist_j = _twist_kernel(v_j, places)
        T_i, T_j = _transform_kernel(pose_i, places, n), _transform_kernel(pose_j, places, n)
        T = relative_kernel(T_i, T_j)
    local, inverse = local_of_relative_kernel(T, twist_j)
    rate = local[6:]
    for i in range(n):
        top, bottom = 0.0, 0.0
        for k in range(i if diagonal else 0, i + 1):
            top += W[i, k] * (local[places[k]] - dt * (v_i[k] + 0.5 * dt * mean[k]))
            bottom += W[i, k] * (rate[places[k]] - v_i[k] - dt * mean[k])
        error[i], error[n + i] = a * top + b * bottom, c * bottom
    if not derivatives:
        return
    by_pose_i, by_v_i = jacobian_at(outputs, 0, 2 * n, n), jacobian_at(outputs, 1, 2 * n, n)
    by_pose_j, by_v_j = jacobian_at(outputs, 2, 2 * n, n), jacobian_at(outputs, 3, 2 * n, n)
    xi_i, xi_j, rate_i, rate_j = local_blocks_kernel(local, inverse, twist_j, higher)
    for i in range(n):
        for j in range(n):
            top_i, top_j, bottom_i, bottom_j = 0.0, 0.0, 0.0, 0.0
            for k in range(i if diagonal else 0, i + 1):
                row, column = places[k], places[j]
                top_i += W[i, k] * xi_i[row, column]
                top_j += W[i, k] * xi_j[row, column]
                bottom_i += W[i, k] * rate_i[row, column]
                bottom_j += W[i, k] * rate_j[row, column]
            by_pose_i[i, j], by_pose_i[n + i, j] = -a * top_i - b * bottom_i, -c * bottom_i
            by_v_i[i, j], by_v_i[n + i, j] = -(a * dt + b) * W[i, j], -c * W[i, j]
            by_pose_j[i, j], by_pose_j[n + i, j] = a * top_j + b * bottom_j, c * bottom_j
            by_v_j[i, j], by_v_j[n + i, j] = b * top_j, c * top_j


@kernel
def whitened_wnoj_kernel(
    pose_i: Array,
    v_i: Array,
    a_i: Array,
    pose_j: Array,
    v_j: Array,
    a_j: Array,
    places: Index,
    constants: Array,
    outputs: Addresses,
) -> None:
    """Write the whitened error (3 n,) and its Jacobians (3 n, n).

    The error is whitened by the Kronecker product of a root (3, 3), upper triangular, and W (n, n),
    lower triangular. The constants are dt, the root and W.
    """
    n = len(v_i)
    root, W = constants[1:10].reshape(3, 3), constants[10:].reshape(n, n)
    whole = wnoj_kernel(
        _transform_kernel(pose_i, places, n),
        _twist_kernel(v_i, places),
        _twist_kernel(a_i, places),
        _transform_kernel(pose_j, places, n),
        _twist_kernel(v_j, places),
        _twist_kernel(a_j, places),
        constants[0],
    )
    error, white = error_at(outputs, 3 * n), np.empty((3, 37))
    for i in range(n):
        white[:] = 0.0
        for s in range(3):
            for k in range(i + 1):
                for column in range(37):
                    white[s, column] += W[i, k] * whole[6 * s + int(places[k]), column]
        for r in range(3):
            for column in range(37):
                white[r, column] *= root[r, r]
                for s in range(r + 1, 3):
                    white[r, column] += root[r, s] * white[s, column]
            error[n * r + i] = white[r, 36]
            for block in range(6):
                jacobian = jacobian_at(outputs, block, 3 * n, n)
                for j in range(n):
                    jacobian[n * r + i, j] = white[r, 6 * block + int(places[j])]
