"""The arithmetic of many tracklets at once: their information on the states they lie between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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

Index = NDArray[np.int64]

_TOLERANCE = 1e-9  # of coordinates, in units of the focal length and of one over a metre
_ROUNDING = 1e-12  # pivots below this, of a unit diagonal, are made of rounding errors


@kernel
def poses_between_kernel(
    T_states: Array, v_states: Array, first: Index, a: Array, b: Array
) -> Array:
    """(n, 4, 4) poses at a (n,) seconds after the state `first` (n,) and b before the next one."""
    local_j = np.empty((len(T_states) - 1, 12))
    for i in range(len(local_j)):
        local_j[i] = local_state_kernel(T_states[i], T_states[i + 1], v_states[i + 1])
    T, v = np.empty((len(a), 4, 4)), np.empty(6)
    for n in range(len(a)):
        i = first[n]
        local = interpolated_local_kernel(v_states[i], local_j[i], hermite_weights(a[n], b[n]))
        moved_kernel(T_states[i], local, T[n], v)
    return T


@kernel
def landmarks_kernel(
    T: Array,
    charts: Array,
    coordinates: Array,
    start: Index,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
    steps: int,
) -> Array:
    """(L, 3) coordinates in the charts (L, 4, 4) after some steps of Gauss-Newton.

    The k-th landmark is measured from start[k] to start[k + 1]. Each step is halved until the error
    falls.
    """
    found = coordinates.copy()
    for k in range(len(found)):
        first, last = start[k], start[k + 1]
        normal = _normal_kernel(
            T, charts[k], found[k], first, last, measured, camera, whitening, weights
        )
        for _ in range(steps):
            step = _newton_step(normal)
            size = np.abs(step).max()
            if not size > _TOLERANCE:
                break
            before, scale, better = normal[3, 3], 1.0, False
            while not better and scale > 1e-3:
                trial = found[k] + scale * step
                normal = _normal_kernel(
                    T, charts[k], trial, first, last, measured, camera, whitening, weights
                )
                better = normal[3, 3] <= before
                scale *= 0.5
            if not better:
                break
            found[k] = trial
    return found


@kernel
def errors_kernel(
    T: Array,
    charts: Array,
    coordinates: Array,
    start: Index,
    measured: Array,
    camera: Array,
    whitening: Array,
) -> Array:
    """(n, 3) whitened errors of all measurements."""
    errors, rows = np.empty((len(T), 3)), np.empty((3, 10))
    for k in range(len(charts)):
        for n in range(start[k], start[k + 1]):
            _rows_kernel(T[n], charts[k], coordinates[k], measured[n], camera, whitening, 1.0, rows)
            errors[n] = rows[:, 9]
    return errors


@inner_kernel
def _normal_kernel(
    T: Array,
    chart: Array,
    q: Array,
    first: int,
    last: int,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
) -> Array:
    """(4, 4) [A e]ᵀ[A e] of measurements `first` to `last`, A by their landmark's coordinates."""
    normal, rows = np.zeros((4, 4)), np.empty((3, 10))
    for n in range(first, last):
        _rows_kernel(T[n], chart, q, measured[n], camera, whitening, weights[n], rows)
        for i in range(4):
            for j in range(4):
                for r in range(3):
                    normal[i, j] += rows[r, 6 + i] * rows[r, 6 + j]
    return normal


@inner_kernel
def _newton_step(normal: Array) -> Array:
    """(3,) least squares step, zero along what is not determined."""
    rest, step = normal.copy(), np.zeros(3)
    for i in range(3):
        if rest[i, i] > 0:
            for k in range(i + 1, 3):
                scale = rest[i, k] / rest[i, i]
                for j in range(i, 4):
                    rest[k, j] -= scale * rest[i, j]
    for i in range(2, -1, -1):
        if rest[i, i] > 0:
            value = -rest[i, 3]
            for j in range(i + 1, 3):
                value -= rest[i, j] * step[j]
            step[i] = value / rest[i, i]
    return step


@inner_kernel
def _rows_kernel(
    T: Array,
    chart: Array,
    q: Array,
    measured: Array,
    camera: Array,
    whitening: Array,
    weight: float,
    rows: Array,
) -> None:
    """Write whitened derivatives (3, 10) by the pose (6) and the coordinates (3), and the error.

    The point is homogeneous, (x, y, 1, inverse depth) in its chart, so that nothing special happens
    at infinity or a little beyond. Behind the camera: a large constant error without derivatives.
    """
    fx, fy, cx, cy, baseline = camera[0], camera[1], camera[2], camera[3], camera[4]
    h, by_q, by_h = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for m in range(3):
            by_q[i, 2] += T[m, i] * (chart[m, 3] - T[m, 3])
            for j in range(2):
                by_q[i, j] += T[m, i] * chart[m, j]
            h[i] += T[m, i] * chart[m, 2]
        for j in range(3):
            h[i] += by_q[i, j] * q[j]
    raw = np.zeros((3, 10))
    if h[2] > 0:
        x, y, inverse = h[0] / h[2], h[1] / h[2], 1 / h[2]
        raw[0, 9] = fx * x + cx - measured[0]
        raw[1, 9] = fy * y + cy - measured[1]
        raw[2, 9] = fx * baseline * q[2] * inverse - measured[2]
        by_h[0, 0], by_h[0, 2] = fx * inverse, -fx * x * inverse
        by_h[1, 1], by_h[1, 2] = fy * inverse, -fy * y * inverse
        by_h[2, 2] = -fx * baseline * q[2] * inverse * inverse
        for i in range(3):
            a, b, c = by_h[i, 0], by_h[i, 1], by_h[i, 2]
            raw[i, 0], raw[i, 1] = b * h[2] - c * h[1], c * h[0] - a * h[2]
            raw[i, 2] = a * h[1] - b * h[0]
            raw[i, 3], raw[i, 4], raw[i, 5] = -q[2] * a, -q[2] * b, -q[2] * c
            for j in range(3):
                raw[i, 6 + j] = a * by_q[0, j] + b * by_q[1, j] + c * by_q[2, j]
        raw[2, 8] += fx * baseline * inverse
    else:
        raw[:, 9] = 2 * fx
    for i in range(3):
        for j in range(10):
            rows[i, j] = 0.0
            for k in range(3):
                rows[i, j] += weight * whitening[i, k] * raw[k, j]


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
    rows = np.empty((3, 10))
    by_landmark, own = np.empty((3, size)), np.empty((3, 3))
    for k in range(len(charts)):
        by_landmark[:], own[:] = 0.0, 0.0
        for n in range(start[k], start[k + 1]):
            i = first[n]
            _rows_kernel(
                T[n], charts[k], coordinates[k], measured[n], camera, whitening, weights[n], rows
            )
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
