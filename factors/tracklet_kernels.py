"""The arithmetic of a tracklet: poses between states, the best landmark, and its elimination."""

from __future__ import annotations

import numpy as np

from factors.kernels import Array, inner_kernel, kernel
from factors.local import (
    EXACT,
    hermite_weights,
    interpolated_local_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    moved_kernel,
    rows_by_states_kernel,
)
from factors.stereo import reprojection_kernel


@kernel
def poses_kernel(T_states: Array, v_states: Array, first: Array, a: Array, b: Array) -> Array:
    """(n, 4, 4) poses at a (n,) seconds after the state `first` (n,) and b before the next one."""
    T, v = np.empty((len(a), 4, 4)), np.empty(6)
    i = -1
    for n in range(len(a)):
        if first[n] > i:  # measurements are in order of time
            i = first[n]
            local_j = local_state_kernel(T_states[i], T_states[i + 1], v_states[i + 1])
        local = interpolated_local_kernel(v_states[i], local_j, hermite_weights(a[n], b[n]))
        moved_kernel(T_states[i], local, T[n], v)
    return T


@kernel
def rows_kernel(
    T: Array, landmark: Array, measured: Array, camera: Array, whitening: Array, weights: Array
) -> Array:
    """(3n, 10) whitened derivatives of all errors by their pose and the landmark, then the errors.

    The weights (n,) scale the three rows of each measurement.
    """
    rows = np.zeros((3 * len(T), 10))
    for n in range(len(T)):
        stereo = reprojection_kernel(T[n], landmark, measured[n], camera)
        for i in range(3):
            for k in range(3):
                for j in range(10):
                    rows[3 * n + i, j] += weights[n] * whitening[i, k] * stereo[k, j]
    return rows


@kernel
def placed_kernel(T: Array, n: int, point: Array) -> Array:
    """(3,) point of the n-th camera frame in the world."""
    placed = np.empty(3)
    for i in range(3):
        placed[i] = T[n, i, 3]
        for j in range(3):
            placed[i] += T[n, i, j] * point[j]
    return placed


@kernel
def landmark_kernel(
    T: Array,
    landmark: Array,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
    steps: int,
) -> Array:
    """(3,) landmark after some steps of Gauss-Newton, each halved until the error falls."""
    point, rows = landmark, rows_kernel(T, landmark, measured, camera, whitening, weights)
    for _ in range(steps):
        change = _newton_step(rows)
        before, scale, better = _squared_error(rows), 1.0, False
        while not better and scale > 1e-3:
            trial, size, distance = np.empty(3), 0.0, 0.0
            for i in range(3):
                trial[i] = point[i] + scale * change[i]
                size += change[i] * change[i]
                distance += (point[i] - T[0, i, 3]) ** 2
            rows = rows_kernel(T, trial, measured, camera, whitening, weights)
            converged = size <= 1e-14 * distance
            better = converged or _squared_error(rows) < before
            scale *= 0.5
        if not better:
            break
        point = trial
        if converged:
            break
    return point


@inner_kernel
def _squared_error(rows: Array) -> float:
    total = 0.0
    for i in range(rows.shape[0]):
        total += rows[i, 9] * rows[i, 9]
    return total


@inner_kernel
def _newton_step(rows: Array) -> Array:
    """(3,) least squares change of the landmark, by cofactors; zero if it is undetermined."""
    A, g = np.zeros((3, 3)), np.zeros(3)
    for row in range(rows.shape[0]):
        for i in range(3):
            g[i] -= rows[row, 6 + i] * rows[row, 9]
            for j in range(3):
                A[i, j] += rows[row, 6 + i] * rows[row, 6 + j]
    cofactors = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            k, m, p, q = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            cofactors[i, j] = A[k, p] * A[m, q] - A[k, q] * A[m, p]
    determinant = 0.0
    for j in range(3):
        determinant += A[0, j] * cofactors[0, j]
    change = np.zeros(3)
    if determinant > 0:
        for i in range(3):
            for j in range(3):
                change[i] += cofactors[i, j] * g[j] / determinant
    return change


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
