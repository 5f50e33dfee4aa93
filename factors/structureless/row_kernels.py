"""Errors of measurements between states, their derivatives, and products of these."""

from __future__ import annotations

import numpy as np

from factors.kernels.compiled import kernel
from factors.kernels.local_variables import (
    chain_rule_kernel,
    local_jacobian_kernel,
    write_hermite_weights,
    write_interpolated_local,
)
from factors.kernels.matrices import copy_kernel
from factors.kernels.se3 import Array
from factors.structureless.landmark_kernels import Index, landmark_rows_kernel, pose_rows_kernel
from factors.structureless.states_between_kernels import next_states_kernel


@kernel
def measurement_rows_kernel(
    T_states: Array,
    v_states: Array,
    order: Index,
    first: Index,
    a: Array,
    b: Array,
    T: Array,
    of: Index,
    charts: Array,
    coordinates: Array,
    measured: Array,
    camera: Array,
    whitening: Array,
    weights: Array,
) -> tuple[Array, Array]:
    """Compute weighted rows (m, 3, 31), and Jacobians (m, 3, 3) of landmarks, of measurements.

    Columns are the Jacobian with respect to the states before and after (24) and to xi at the
    measurement's own time (6), then the error. The measurements n = order[...] are a[n] seconds
    after the state first[n] and b[n] before the next one, from the pose T[n], of landmark of[n].
    """
    local_j = next_states_kernel(T_states, v_states)
    by_states_j = np.empty((len(local_j), 12, 24))
    for i in range(len(local_j)):
        copy_kernel(local_jacobian_kernel(local_j[i], v_states[i + 1]), by_states_j[i])
    result, by_landmark = np.empty((len(order), 3, 31)), np.empty((len(order), 3, 3))
    h, by_h, rows, chained = np.empty(3), np.empty((3, 3)), np.empty((3, 10)), np.empty((3, 30))
    landmarks, sensor, work = (charts, coordinates), (camera, whitening), (h, by_h, rows)
    share, local = np.empty((2, 2, 2)), np.empty(12)
    for m in range(len(order)):
        n = order[m]
        i, k = first[n], of[n]
        landmark_rows_kernel(T, n, landmarks, k, measured, n, sensor, work)
        pose_rows_kernel(coordinates[k, 2], h, by_h, weights[n], rows)
        write_hermite_weights(a[n], b[n], share)
        write_interpolated_local(v_states[i], local_j[i], share, local)
        chain_rule_kernel(rows, local, by_states_j[i], share, chained)
        for r in range(3):
            for c in range(30):
                result[m, r, c] = chained[r, c]
            result[m, r, 30] = rows[r, 9]
            for c in range(3):
                by_landmark[m, r, c] = rows[r, 6 + c]
    return result, by_landmark


@kernel
def spread_rows_kernel(rows: Array, gains: Array) -> Array:
    """Rows (n, 3, 25 + 6 r) whose columns are both states, the variables of xi, and the error.

    Each of n measurements determines each component of xi by r variables with its gains (n, r).
    """
    r = gains.shape[1]
    J = np.empty((len(rows), 3, 25 + 6 * r))
    for m in range(len(rows)):
        for i in range(3):
            line, found = J[m, i], rows[m, i]
            for j in range(24):
                line[j] = found[j]
            for j in range(6):
                for g in range(r):
                    line[24 + j * r + g] = found[24 + j] * gains[m, g]
            line[-1] = found[30]
    return J


@kernel
def add_square_kernel(square: Array, state: float, latent: float, H: Array) -> None:
    """Add JᵀJ of rows between two states, whose columns in H begin there, to H."""
    last, width = len(H) - 1, len(square) - 1
    for i in range(width + 1):
        row = int(state) + i if i < 24 else int(latent) + i - 24 if i < width else last
        line = square[i]
        for j in range(24):
            H[row, int(state) + j] += line[j]
        for j in range(24, width):
            H[row, int(latent) + j - 24] += line[j]
        H[row, last] += line[width]


@kernel
def add_products_kernel(
    of: Index,
    state: float,
    latent: float,
    rows: Array,
    gains: Array,
    by_landmark: Array,
    cross: Array,
    own: Array,
) -> None:
    """Add products of the Jacobians of landmarks with all others, and with themselves.

    Measurement m is of landmark of[m]. Columns in `cross` (L, 3, size) begin at `state` and at
    `latent`, see `spread_rows_kernel`; the last one is the error's. `own` is (L, 3, 3).
    """
    r, start, begin = gains.shape[1], int(state), int(latent)
    for m in range(len(of)):
        k, a, b, c, gain = of[m], rows[m, 0], rows[m, 1], rows[m, 2], gains[m]
        for p in range(3):
            x, y, z = by_landmark[m, 0, p], by_landmark[m, 1, p], by_landmark[m, 2, p]
            line = cross[k, p]
            both, between = line[start : start + 24], line[begin : begin + 6 * r]
            for j in range(24):
                both[j] += x * a[j] + y * b[j] + z * c[j]
            for j in range(6):
                value = x * a[24 + j] + y * b[24 + j] + z * c[24 + j]
                for g in range(r):
                    between[j * r + g] += value * gain[g]
            line[-1] += x * a[30] + y * b[30] + z * c[30]
            for s in range(3):
                own[k, p, s] += (
                    x * by_landmark[m, 0, s] + y * by_landmark[m, 1, s] + z * by_landmark[m, 2, s]
                )


@kernel
def whiten_kernel(own: Array, cross: Array, known: Array) -> None:
    """Replace each `own` (3, 3) by its root U, UᵀU = own, and `cross` (3, size) by U⁻ᵀ cross.

    Where it is singular, known[k] is 0 instead of 1, and `cross` is zero: nothing measures that
    landmark.
    """
    for k in range(len(own)):
        known[k] = 1.0
        for i in range(3):
            for m in range(i):
                scale = own[k, m, i]
                for j in range(i, 3):
                    own[k, i, j] -= scale * own[k, m, j]
                for j in range(cross.shape[2]):
                    cross[k, i, j] -= scale * cross[k, m, j]
            if not own[k, i, i] > 0:
                known[k] = 0.0
                cross[k] = 0.0
                break
            scale = 1 / np.sqrt(own[k, i, i])
            for j in range(3):
                own[k, i, j] *= scale if j >= i else 0.0
            for j in range(cross.shape[2]):
                cross[k, i, j] *= scale


@kernel
def solve_kernel(root: Array, known: Array, x: Array) -> None:
    """Replace x (L, 3) by the solution of root (L, 3, 3) times it, by zero where not known."""
    for k in range(len(x)):
        for i in range(2, -1, -1):
            for j in range(i + 1, 3):
                x[k, i] -= root[k, i, j] * x[k, j]
            x[k, i] = x[k, i] / root[k, i, i] if known[k] > 0 else 0.0
