"""The arithmetic of many tracklets at once: their information on the states they lie between."""

from __future__ import annotations

import numpy as np

from factors.kernels import (
    EXACT,
    Array,
    hermite_weights,
    inner_kernel,
    interpolated_local_kernel,
    kernel,
    local_jacobian_kernel,
    local_state_kernel,
    rows_by_states_kernel,
)
from factors.structureless.landmark_kernels import Index, landmark_rows_kernel, pose_rows_kernel

_ROUNDING = 1e-12  # pivots below this, of a unit diagonal, are made of rounding errors


@kernel
def information_kernel(
    T_states: Array,
    v_states: Array,
    first: Index,
    a: Array,
    b: Array,
    T: Array,
    coordinates: Array,
    nearest: Index,
    start: Index,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
) -> tuple[Array, Array]:
    """Upper triangles (12 m + 1, 12 m + 1) of [J e]ᵀ[J e], and of what landmarks explain of it.

    J are the derivatives by the m states and e the errors. The difference, Schur's complement, is
    of their projections onto what no shift of the landmarks explains.
    """
    size = 12 * len(T_states) + 1
    H, explained = np.zeros((size, size)), np.zeros((size, size))
    local_j, by_states_j = np.empty((len(T_states) - 1, 12)), np.empty((len(T_states) - 1, 12, 24))
    for i in range(len(local_j)):
        local_j[i] = local_state_kernel(T_states[i], T_states[i + 1], v_states[i + 1])
        by_states_j[i] = local_jacobian_kernel(local_j[i], v_states[i + 1], EXACT)
    h, by_h, rows = np.empty(3), np.empty((3, 3)), np.empty((3, 10))
    for k in range(len(coordinates)):
        chart, q = T[nearest[k]], coordinates[k]
        by_landmark, own = np.zeros((3, size)), np.zeros((3, 3))
        for n in range(start[k], start[k + 1]):
            i = first[n]
            landmark_rows_kernel(T[n], chart, q, measured[n], camera, whitening, h, by_h, rows)
            pose_rows_kernel(q, h, by_h, weights[n], rows)
            share = hermite_weights(a[n], b[n])
            local = interpolated_local_kernel(v_states[i], local_j[i], share)
            by_states = rows_by_states_kernel(rows, 0, local, by_states_j[i], share)
            _add_kernel(rows, by_states, 12 * i, H, by_landmark, own)
        low, high = 12 * first[start[k]], 12 * first[start[k + 1] - 1] + 24
        if _whiten_kernel(own, by_landmark):
            _add_squares_kernel(by_landmark, low, high, explained)
    return H, explained


@inner_kernel
def _add_kernel(
    rows: Array, by_states: Array, column: int, H: Array, by_landmark: Array, own: Array
) -> None:
    """Add a measurement's products to those of the states, from a column on, and its landmark."""
    last = len(H) - 1
    x, y, z = by_states[0], by_states[1], by_states[2]
    for i in range(24):
        a, b, c = x[i], y[i], z[i]
        line = H[column + i, column : column + 24]
        for j in range(24):
            line[j] += a * x[j] + b * y[j] + c * z[j]
        H[column + i, last] += a * rows[0, 9] + b * rows[1, 9] + c * rows[2, 9]
    for i in range(3):
        a, b, c = rows[0, 6 + i], rows[1, 6 + i], rows[2, 6 + i]
        line = by_landmark[i, column : column + 24]
        for j in range(24):
            line[j] += a * x[j] + b * y[j] + c * z[j]
        by_landmark[i, last] += a * rows[0, 9] + b * rows[1, 9] + c * rows[2, 9]
        for j in range(3):
            own[i, j] += a * rows[0, 6 + j] + b * rows[1, 6 + j] + c * rows[2, 6 + j]
        H[last, last] += rows[i, 9] * rows[i, 9]


@inner_kernel
def _whiten_kernel(own: Array, by_landmark: Array) -> bool:
    """Divide `by_landmark` (3, n) by the root of its landmark's information (3, 3).

    False if that is singular: the landmark explains nothing.
    """
    for i in range(3):
        for m in range(i):
            scale = own[m, i]
            for j in range(i, 3):
                own[i, j] -= scale * own[m, j]
            for j in range(by_landmark.shape[1]):
                by_landmark[i, j] -= scale * by_landmark[m, j]
        if not own[i, i] > 0:
            return False
        scale = 1 / np.sqrt(own[i, i])
        for j in range(i, 3):
            own[i, j] *= scale
        for j in range(by_landmark.shape[1]):
            by_landmark[i, j] *= scale
    return True


@inner_kernel
def _add_squares_kernel(rows: Array, low: int, high: int, to: Array) -> None:
    """Add the upper triangle of rowsᵀ rows; but for `low` to `high` and last, the rows are zero."""
    last = len(to) - 1
    for i in range(low, high):
        a, b, c = rows[0, i], rows[1, i], rows[2, i]
        x, y, z, line = rows[0, i:high], rows[1, i:high], rows[2, i:high], to[i, i:high]
        for j in range(len(line)):
            line[j] += a * x[j] + b * y[j] + c * z[j]
        to[i, last] += a * rows[0, last] + b * rows[1, last] + c * rows[2, last]
    for r in range(3):
        to[last, last] += rows[r, last] * rows[r, last]


@kernel
def root_kernel(H: Array, scale: Array) -> Array:
    """R (D, D), RᵀR = H, of the upper triangle of H, which may be singular.

    Cholesky with pivoting, in units of the scale (D,): what is left in the end is rounding errors,
    which without pivoting grow from row to row. The last column, of the errors, stays the last.
    """
    size = len(H)
    R, rest, column = np.zeros(H.shape), np.zeros(H.shape), np.arange(size)
    for i in range(size):
        for j in range(i, size):
            unit = scale[i] * scale[j]
            rest[i, j] = rest[j, i] = H[i, j] / unit if unit > 0 else 0.0
    for i in range(size - 1):
        best = i
        for k in range(i + 1, size - 1):
            if rest[k, k] > rest[best, best]:
                best = k
        if not rest[best, best] > _ROUNDING:
            break
        _swap_kernel(rest, column, i, best)
        pivot = np.sqrt(rest[i, i])
        for j in range(i, size):
            rest[i, j] /= pivot
            R[i, column[j]] = rest[i, j] * scale[column[j]]
        for k in range(i + 1, size):
            value = rest[i, k]
            for j in range(i + 1, size):
                rest[k, j] -= value * rest[i, j]
    R[-1, -1] = scale[-1] * np.sqrt(max(rest[-1, -1], 0.0))
    return R


@inner_kernel
def _swap_kernel(matrix: Array, column: Index, i: int, j: int) -> None:
    """Swap rows and columns i and j."""
    column[i], column[j] = column[j], column[i]
    for k in range(len(matrix)):
        matrix[i, k], matrix[j, k] = matrix[j, k], matrix[i, k]
    for k in range(len(matrix)):
        matrix[k, i], matrix[k, j] = matrix[k, j], matrix[k, i]
