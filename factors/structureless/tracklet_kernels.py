"""The arithmetic of a tracklet: its errors' derivatives by the states, without the landmark."""

from __future__ import annotations

import numpy as np

from factors.kernels import (
    EXACT,
    Array,
    hermite_weights,
    interpolated_local_kernel,
    kernel,
    local_jacobian_kernel,
    local_state_kernel,
    rows_by_states_kernel,
)
from factors.structureless.landmark_kernels import Index, landmark_rows_kernel, pose_rows_kernel


@kernel
def rows_kernel(
    T: Array,
    coordinates: Array,
    nearest: Index,
    start: Index,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
) -> Array:
    """(3n, 10) whitened derivatives of all errors by their pose and the landmark, then the errors.

    The squares of each measurement are times its weight, of weights (n,).
    """
    rows, h, by_h = np.empty((3 * len(T), 10)), np.empty(3), np.empty((3, 3))
    chart, q = T[nearest[0]], coordinates[0]
    for n in range(start[0], start[1]):
        own = rows[3 * n : 3 * n + 3]
        landmark_rows_kernel(T[n], chart, q, measured[n], camera, whitening, h, by_h, own)
        pose_rows_kernel(q, h, by_h, weights[n], own)
    return rows


@kernel
def states_rows_kernel(
    T_states: Array, v_states: Array, first: Array, a: Array, b: Array, rows: Array
) -> Array:
    """(3n, 3 + 12m + 1) derivatives by the landmark and the m states, then the errors."""
    last = 3 + 12 * len(T_states)
    result = np.zeros((rows.shape[0], last + 1))
    i = -1
    for n in range(len(a)):
        if first[n] > i:  # measurements are in order of time
            i = first[n]
            local_j = local_state_kernel(T_states[i], T_states[i + 1], v_states[i + 1])
            by_states_j = local_jacobian_kernel(local_j, v_states[i + 1], EXACT)
        weights = hermite_weights(a[n], b[n])
        local = interpolated_local_kernel(v_states[i], local_j, weights)
        by_states = rows_by_states_kernel(rows, 3 * n, local, by_states_j, weights)
        for row in range(3):
            for j in range(24):
                result[3 * n + row, 3 + 12 * i + j] = by_states[row, j]
            for j in range(3):
                result[3 * n + row, j] = rows[3 * n + row, 6 + j]
            result[3 * n + row, last] = rows[3 * n + row, 9]
    return result


@kernel
def eliminate_kernel(matrix: Array) -> None:
    """Triangularise the first three columns by Householder reflections, in place.

    What is left from row and column 3 on is the projection onto the null space of the landmark.
    """
    for column in range(3):
        squares = 0.0
        for i in range(column, matrix.shape[0]):
            squares += matrix[i, column] * matrix[i, column]
        if squares > 0:
            head = matrix[column, column]
            alpha = -np.sqrt(squares) if head > 0 else np.sqrt(squares)
            normal = np.empty(matrix.shape[0] - column)
            for i in range(len(normal)):
                normal[i] = matrix[column + i, column]
            normal[0] = head - alpha
            factor = 1 / (squares - alpha * head)  # 2 / normal . normal
            dots = np.zeros(matrix.shape[1])
            for i in range(len(normal)):
                for j in range(column, matrix.shape[1]):
                    dots[j] += normal[i] * matrix[column + i, j]
            for i in range(len(normal)):
                for j in range(column, matrix.shape[1]):
                    matrix[column + i, j] -= factor * normal[i] * dots[j]
