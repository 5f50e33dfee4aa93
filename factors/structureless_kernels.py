"""The arithmetic of many tracklets at once: their information on the states they lie between."""

from __future__ import annotations

import numpy as np

from factors.kernels import Array, inner_kernel, kernel
from factors.landmark_kernels import Index, landmark_rows_kernel, pose_rows_kernel
from factors.local import (
    EXACT,
    hermite_weights,
    interpolated_local_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    rows_by_states_kernel,
)

_ROUNDING = 1e-12  # pivots below this, of a unit diagonal, are made of rounding errors


@kernel
def information_kernel(
    T_states: Array,
    v_states: Array,
    first: Index,
    a: Array,
    b: Array,
    T: Array,
    charts: Array,
    coordinates: Array,
    start: Index,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
) -> tuple[Array, Array]:
    """(12 m + 1, 12 m + 1) upper triangle of [J e]ᵀ[J e] of m states, the landmarks eliminated.

    J are the derivatives by the states and e the errors, projected onto what no shift of the
    landmarks explains: the Schur complement. And (12 m + 1,) norms of the columns before that,
    which rounding errors are relative to.
    """
    size = 12 * len(T_states) + 1
    H, squares = np.zeros((size, size)), np.zeros(size)
    local_j, by_states_j = np.empty((len(T_states) - 1, 12)), np.empty((len(T_states) - 1, 12, 24))
    for i in range(len(local_j)):
        local_j[i] = local_state_kernel(T_states[i], T_states[i + 1], v_states[i + 1])
        by_states_j[i] = local_jacobian_kernel(local_j[i], v_states[i + 1], EXACT)
    h, by_h, rows = np.empty(3), np.empty((3, 3)), np.empty((3, 10))
    by_landmark, own = np.empty((3, size)), np.empty((3, 3))
    for k in range(len(charts)):
        by_landmark[:], own[:] = 0.0, 0.0
        for n in range(start[k], start[k + 1]):
            i = first[n]
            landmark_rows_kernel(
                T[n], charts[k], coordinates[k], measured[n], camera, whitening, h, by_h, rows
            )
            pose_rows_kernel(coordinates[k], h, by_h, weights[n], rows)
            share = hermite_weights(a[n], b[n])
            local = interpolated_local_kernel(v_states[i], local_j[i], share)
            by_states = rows_by_states_kernel(rows, 0, local, by_states_j[i], share)
            _add_measurement_kernel(rows, by_states, 12 * i, H, squares, by_landmark, own)
        low, high = 12 * first[start[k]], 12 * first[start[k + 1] - 1] + 24
        _eliminate_kernel(own, by_landmark, low, high, H)
    return H, np.sqrt(squares)


@inner_kernel
def _add_measurement_kernel(
    rows: Array,
    by_states: Array,
    column: int,
    H: Array,
    squares: Array,
    by_landmark: Array,
    own: Array,
) -> None:
    """Add a measurement's products to those of the states and of its landmark."""
    last = len(H) - 1
    for i in range(24):
        x, y, z = by_states[0, i], by_states[1, i], by_states[2, i]
        squares[column + i] += x * x + y * y + z * z
        for j in range(i, 24):
            H[column + i, column + j] += (
                x * by_states[0, j] + y * by_states[1, j] + z * by_states[2, j]
            )
        H[column + i, last] += x * rows[0, 9] + y * rows[1, 9] + z * rows[2, 9]
    for r in range(3):
        H[last, last] += rows[r, 9] * rows[r, 9]
        squares[last] += rows[r, 9] * rows[r, 9]
        for i in range(3):
            value = rows[r, 6 + i]
            by_landmark[i, last] += value * rows[r, 9]
            for j in range(24):
                by_landmark[i, column + j] += value * by_states[r, j]
            for j in range(3):
                own[i, j] += value * rows[r, 6 + j]


@inner_kernel
def _eliminate_kernel(own: Array, by_landmark: Array, low: int, high: int, H: Array) -> None:
    """Subtract what a landmark explains; `by_landmark` is zero but for `low` to `high` and last.

    A landmark without information of its own explains nothing.
    """
    last = len(H) - 1
    for i in range(3):
        for m in range(i):
            scale = own[m, i] / own[m, m]
            for j in range(m, 3):
                own[i, j] -= scale * own[m, j]
            for j in range(low, high):
                by_landmark[i, j] -= scale * by_landmark[m, j]
            by_landmark[i, last] -= scale * by_landmark[m, last]
        if not own[i, i] > 0:
            return
    x, y, z = by_landmark[0], by_landmark[1], by_landmark[2]
    for i in range(low, high):
        p, q, r = x[i] / own[0, 0], y[i] / own[1, 1], z[i] / own[2, 2]
        for j in range(i, high):
            H[i, j] -= p * x[j] + q * y[j] + r * z[j]
        H[i, last] -= p * x[last] + q * y[last] + r * z[last]
    for i in range(3):
        H[last, last] -= by_landmark[i, last] * by_landmark[i, last] / own[i, i]


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
        best = i + int(np.argmax(np.diag(rest)[i : size - 1]))
        if not rest[best, best] > _ROUNDING:
            break
        _swap_kernel(rest, column, i, best)
        rest[i, i:] /= np.sqrt(rest[i, i])
        for j in range(i, size):
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
