"""Rows of what is known of landmarks from before a window: see `LandmarkPrior`."""

from __future__ import annotations

import numpy as np

from factors.kernels.compiled import bare_kernel, kernel
from factors.kernels.matrices import copy_vector_kernel
from factors.kernels.se3 import (
    RIGHT,
    Array,
    inverse_coefficients_kernel,
    log_kernel,
    relative_kernel,
    se3_polynomial_kernel,
)
from factors.kernels.triangular import factorize_kernel, solve_lower_kernel
from factors.structureless.landmark_kernels import Index, pose_rows_kernel, prior_rows_kernel


@kernel
def moved_rows_kernel(
    T_prior: Array, v_prior: Array, T: Array, v: Array, known: Array, rows: Array
) -> None:
    """Count the rows (P, 3, d + 12 + 1) of a prior from another state, given a copy of them.

    Those of the pose are multiplied by the inverse of Jr(step), and A dx is added to the error.
    """
    state, dx = rows.shape[2] - 13, np.empty(12)
    copy_vector_kernel(log_kernel(relative_kernel(T_prior, T)), dx)
    for i in range(6):
        dx[6 + i] = v[i] - v_prior[i]
    inverse = se3_polynomial_kernel(dx, inverse_coefficients_kernel(dx, RIGHT))
    for p in range(len(rows)):
        for r in range(3):
            line, a = rows[p, r], known[p, r, state:]
            for c in range(6):
                line[state + c] = 0.0
                for k in range(6):
                    line[state + c] += a[k] * inverse[k, c]
            for c in range(12):
                line[-1] += a[c] * dx[c]


@kernel
def prior_system_kernel(
    views: Array,
    turns: Array,
    charts: Array,
    coordinates: Array,
    seen: Array,
    root: Array,
    rows: Array,
    by_landmark: Array,
) -> None:
    """Complete the rows (P, 3, d + 12 + 1) of a prior, and write those by its landmarks (P, 3, 3).

    Rows hold those of `LandmarkPrior.at`; the error of the coordinates and its Jacobian with
    respect to the first state's pose are added. The views (P, 4, 4) are that pose, turned by
    R_cam_view (P, 3, 3), the charts (P, 4, 4) and coordinates (P, 3) those of the landmarks.
    """
    state = rows.shape[2] - 13
    h, by_h, found = np.empty(3), np.empty((3, 3)), np.empty((3, 10))
    known = seen, root, np.zeros((len(rows), 3)), np.array([1.0, 1.0, 0.0, 0.0, 1.0])
    landmarks = charts, coordinates
    for p in range(len(rows)):
        prior_rows_kernel(views, landmarks, p, known, p, (h, by_h, found))
        pose_rows_kernel(coordinates[p, 2], h, by_h, 1.0, found)
        _turn_kernel(turns, p, found)
        for r in range(3):
            rows[p, r, -1] += found[r, 9]
            for c in range(6):
                rows[p, r, state + c] += found[r, c]
            for c in range(3):
                by_landmark[p, r, c] = found[r, 6 + c]


@kernel
def add_prior_products_kernel(
    of: Index, first: float, rows: Array, by_landmark: Array, cross: Array, own: Array
) -> None:
    """Add the same of the rows of a prior, whose columns begin at the first one in `cross`."""
    start, count = int(first), rows.shape[2] - 1
    for m in range(len(of)):
        a, b, c = rows[m, 0], rows[m, 1], rows[m, 2]
        for p in range(3):
            x, y, z = by_landmark[m, 0, p], by_landmark[m, 1, p], by_landmark[m, 2, p]
            line = cross[of[m], p]
            part = line[start : start + count]
            for j in range(count):
                part[j] += x * a[j] + y * b[j] + z * c[j]
            line[-1] += x * a[count] + y * b[count] + z * c[count]
            for s in range(3):
                own[of[m], p, s] += (
                    x * by_landmark[m, 0, s] + y * by_landmark[m, 1, s] + z * by_landmark[m, 2, s]
                )


@kernel
def known_from_kernel(
    views: Array,
    turns: Array,
    place: Index,
    charts: Array,
    coordinates: Array,
    moved: Array,
    own: Array,
    turned: Array,
    seen: Array,
    root: Array,
    rows: Array,
) -> None:
    """Write what is known of landmarks (n,) as they are seen in views, at their place (n,).

    The views (n, 4, 4) are those of a pose, turned by R_cam_view (n, 3, 3). The landmarks' own rows
    (n, 3, 3) are with respect to coordinates (n, 3) in the charts; `turned` holds those of the
    variables that are kept (d), of the state there (12), of the error, and of the other variables,
    which only add noise, as the move of the coordinates by (n, 3) deviations does.
    Written are the coordinates (P, 3), and the rows of these (P, 3, 3) and of the first d + 12 + 1
    columns, the noise being one.
    """
    h, by_h, found = np.empty(3), np.empty((3, 3)), np.empty((3, 10))
    noise, inverse = np.empty((3, 3)), np.empty((3, 3))
    zero, eye = np.zeros((len(place), 3)), np.zeros((len(place), 3, 3))
    for n in range(len(place)):
        for i in range(3):
            eye[n, i, i] = 1.0
    known, width = (zero, eye, zero, np.array([1.0, 1.0, 0.0, 0.0, 1.0])), rows.shape[2]
    landmarks = charts, coordinates
    for n in range(len(place)):
        p = place[n]
        prior_rows_kernel(views, landmarks, n, known, n, (h, by_h, found))
        pose_rows_kernel(coordinates[n, 2], h, by_h, 1.0, found)
        _turn_kernel(turns, n, found)
        _inverse_kernel(found, inverse)
        for i in range(3):
            seen[p, i] = found[i, 9]
            for j in range(3):
                root[p, i, j] = 0.0
                for m in range(3):
                    root[p, i, j] += own[n, i, m] * inverse[m, j]
            for j in range(width):
                rows[p, i, j] = turned[n, i, j]
            for j in range(6):
                for m in range(3):
                    rows[p, i, width - 13 + j] -= root[p, i, m] * found[m, j]
        for i in range(3):
            for j in range(i + 1):
                noise[i, j] = 1.0 if i == j else 0.0
                for m in range(3):
                    noise[i, j] += root[p, i, m] * root[p, j, m] * moved[n, m] * moved[n, m]
                for m in range(width, turned.shape[2]):
                    noise[i, j] += turned[n, i, m] * turned[n, j, m]
        factorize_kernel(noise)
        solve_lower_kernel(noise, root[p])
        solve_lower_kernel(noise, rows[p])


@bare_kernel
def _turn_kernel(turns: Array, p: int, rows: Array) -> None:
    """Make of the Jacobian of a view, columns 0 to 5 of rows (3, 10), that of the camera's pose.

    The camera turned by ω turns the view by Rᵀ ω, R = turns[p]; so for its shifts.
    """
    for i in range(3):
        for first in (0, 3):
            x, y, z = rows[i, first], rows[i, first + 1], rows[i, first + 2]
            for c in range(3):
                rows[i, first + c] = turns[p, c, 0] * x + turns[p, c, 1] * y + turns[p, c, 2] * z


@bare_kernel
def _inverse_kernel(rows: Array, inverse: Array) -> None:
    """Write the inverse (3, 3) of the columns 6 to 8 of rows (3, 10)."""
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, 6 + (i + 1) % 3, 6 + (i + 2) % 3
            inverse[i, j] = rows[a, c] * rows[b, d] - rows[a, d] * rows[b, c]
    determinant = 0.0
    for i in range(3):
        determinant += rows[0, 6 + i] * inverse[i, 0]
    for i in range(3):
        for j in range(3):
            inverse[i, j] /= determinant
