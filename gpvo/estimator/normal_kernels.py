"""Normal equations of a window of states: the information matrix and the gradient, added up.

A state has twelve columns, pose and twist, rotation first; a landmark has three. Of the information
matrix the upper triangle is written alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.se3 import Array, inner_kernel, kernel

Index = NDArray[np.int64]


@kernel
def add_block_kernel(block: Array, columns: Index, H: Array) -> None:
    """Add a symmetric block (n, n) at some columns (n,) to the upper triangle of H."""
    for i in range(len(columns)):
        for j in range(i, len(columns)):
            row, column = min(columns[i], columns[j]), max(columns[i], columns[j])
            H[row, column] += block[i, j]


@kernel
def add_motion_kernel(rows: Array, state: Index, H: Array, g: Array) -> None:
    """Add JᵀJ to the upper triangle of H and Jᵀe to g; rows (K - 1, 12, 25) hold J and e.

    The columns of the states (K,) begin at `state`.
    """
    block = np.empty((24, 25))
    for k in range(len(rows)):
        block[:] = 0.0
        _add_products_kernel(rows[k], rows[k], block)
        _add_states_kernel(block, state[k], state[k + 1], H, g)


@kernel
def add_stereo_kernel(
    rows: Array, interval: Index, landmark: Index, state: Index, H: Array, g: Array
) -> None:
    """Add JᵀJ to the upper triangle of H and Jᵀe to g; rows (N, 3, 28) are of `stereo_kernel`.

    Parameters
    ----------
    interval
        (N,) increasing numbers of the states before the measurements.
    landmark, state
        First columns of the measurements' landmarks (N,) and of the states (K,).
    """
    block = np.zeros((24, 25))
    for n in range(len(rows)):
        k = interval[n]
        _add_products_kernel(rows[n], rows[n], block)
        for i in range(3):
            row, by_i = landmark[n] + i, rows[n, :, 24 + i]
            cross = by_i[0] * rows[n, 0] + by_i[1] * rows[n, 1] + by_i[2] * rows[n, 2]
            g[row] += cross[27]
            for j in range(i, 3):
                H[row, landmark[n] + j] += cross[24 + j]
            _add_row_kernel(cross, row, state[k], state[k + 1], H)
        if n + 1 == len(rows) or interval[n + 1] > k:
            _add_states_kernel(block, state[k], state[k + 1], H, g)
            block[:] = 0.0


@kernel
def add_bridge_kernel(
    rows: Array,
    information: Array,
    solved: Array,
    landmark: Index,
    state: Index,
    H: Array,
    g: Array,
) -> None:
    """Add JᵀWJ to the upper triangle of H and JᵀWe to g, of errors that are correlated.

    Parameters
    ----------
    rows
        (m, 3, 28) of `stereo_kernel`, all between the same two states.
    information
        (3 m, 3 m) symmetric W, of which the upper triangle is read.
    solved
        (m, 3, 25) W times the derivatives by both states and the error.
    landmark, state
        First columns of the measurements' landmarks (m,) and of both states (2,).
    """
    block = np.zeros((24, 25))
    for n in range(len(rows)):
        _add_products_kernel(rows[n], solved[n], block)
        for i in range(3):
            row, by_i = landmark[n] + i, rows[n, :, 24 + i]
            cross = by_i[0] * solved[n, 0] + by_i[1] * solved[n, 1] + by_i[2] * solved[n, 2]
            g[row] += cross[24]
            _add_row_kernel(cross, row, state[0], state[1], H)
        for m in range(n, len(rows)):
            _add_landmarks_kernel(rows, information, n, m, landmark, H)
    _add_states_kernel(block, state[0], state[1], H, g)


@inner_kernel
def _add_landmarks_kernel(
    rows: Array, information: Array, n: int, m: int, landmark: Index, H: Array
) -> None:
    """Add what measurements n and m >= n tell of their landmarks together."""
    by_m = np.zeros((3, 3))
    for r in range(3):
        for s in range(3):
            weight = information[min(3 * n + r, 3 * m + s), max(3 * n + r, 3 * m + s)]
            for j in range(3):
                by_m[r, j] += weight * rows[m, s, 24 + j]
    for i in range(3):
        for j in range(i if n == m else 0, 3):
            value = 0.0
            for r in range(3):
                value += rows[n, r, 24 + i] * by_m[r, j]
            row, column = landmark[n] + i, landmark[m] + j
            H[min(row, column), max(row, column)] += value
            if row == column and n != m:  # the same landmark twice: once for each order
                H[row, row] += value


@inner_kernel
def _add_products_kernel(left: Array, right: Array, block: Array) -> None:
    """Add AᵀB to a block (24, 25): A the first columns of `left`, B those of `right` and its last.

    Both have rows in multiples of three, which are taken at once to read the block less often.
    """
    last = right.shape[1] - 1
    for r in range(0, len(left), 3):
        a, b, c = right[r], right[r + 1], right[r + 2]
        for i in range(24):
            x, y, z = left[r, i], left[r + 1, i], left[r + 2, i]
            for j in range(24):
                block[i, j] += x * a[j] + y * b[j] + z * c[j]
            block[i, 24] += x * a[last] + y * b[last] + z * c[last]


@inner_kernel
def _add_row_kernel(values: Array, row: int, first: int, second: int, H: Array) -> None:
    """Add values (24,) where a landmark's row meets the columns of two states."""
    for half in range(2):
        column = second if half else first
        for j in range(12):
            if row < column:
                H[row, column + j] += values[12 * half + j]
            else:
                H[column + j, row] += values[12 * half + j]


@inner_kernel
def _add_states_kernel(block: Array, first: int, second: int, H: Array, g: Array) -> None:
    """Add the block (24, 25) of two states, whose columns begin at `first` < `second`."""
    for i in range(24):
        row = first + i if i < 12 else second + i - 12
        g[row] += block[i, 24]
        for j in range(i, 24):
            H[row, first + j if j < 12 else second + j - 12] += block[i, j]
