"""The arithmetic of landmarks that are seen from many poses: where they fit best.

A landmark's coordinates are (x / z, y / z, 1 / z) in a frame of its own, its chart: homogeneous, so
that nothing special happens at infinity or a little beyond. The k-th landmark's measurements are
those from start[k] to start[k + 1], and prior[k] is the number of its prior, or -1: a measurement
of these coordinates in the frame of its view (see `LandmarkPrior`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import bare_kernel, kernel
from factors.kernels.se3 import Array
from factors.structureless.robust_losses import loss_kernel

Index = NDArray[np.int64]
Pair = tuple[Array, Array]
Work = tuple[Array, Array, Array]
Known = tuple[Array, Array, Array, Array]

# Squared distance to the optimum in standard deviations, of one and the cost, of the last step.
_CONVERGED = 1e-12


@kernel
def nearest_kernel(start: Index, measured: Array) -> Index:
    """(L,) the nearest measurement of each landmark: of the largest disparity, -1 for none."""
    nearest = np.full(len(start) - 1, -1)
    for k in range(len(nearest)):
        for n in range(start[k], start[k + 1]):
            if nearest[k] < 0 or measured[n, 2] >= measured[nearest[k], 2]:
                nearest[k] = n
    return nearest


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
    loss: Array,
    views: Array,
    prior: Index,
    seen: Array,
    root: Array,
    offset: Array,
    steps: int,
) -> tuple[Array, Array]:
    """(L, 3) coordinates in the charts (L, 4, 4) after some steps of Newton's method.

    Also the norms (n,) of the whitened errors there. The losses are times the weights (n,). The
    priors' errors are root (P, 3, 3) times the difference from seen (P, 3) in the views (P, 4, 4),
    plus offset (P, 3). A step is halved until the cost falls; it is one of iteratively reweighted
    least squares where the cost is not convex. The last one, too small for the cost to tell, is
    taken as it is.
    """
    found, trial, distances = coordinates.copy(), coordinates.copy(), np.empty(len(T))
    system, step, factors = np.empty((7, 4)), np.zeros(3), np.empty((2, 3, 3))
    work, tried = (np.empty(3), np.empty((3, 3)), np.empty((3, 10))), (charts, trial)
    known = seen, root, offset, np.array([1.0, 1.0, 0.0, 0.0, 1.0])
    sensor = camera, whitening
    for k in range(len(found)):
        left, before, scale, settled = steps, np.inf, 1.0, False
        while True:
            system[:] = 0.0
            if prior[k] >= 0:
                _add_prior_kernel(views, tried, k, known, prior[k], work, system)
            for n in range(start[k], start[k + 1]):
                landmark_rows_kernel(T, n, tried, k, measured, n, sensor, work)
                _add_measurement_kernel(work[2], n, weights, loss, system, distances)
            last = settled or scale == 0.0
            if last or system[6, 0] <= before:
                for i in range(3):
                    found[k, i] = trial[k, i]
                if last or left == 0:
                    break
                left, before, scale = left - 1, system[6, 0], 1.0
                length = _step_kernel(system, factors[0], factors[1], step)
                settled = length <= _CONVERGED * (1 + before)
            else:
                scale = 0.5 * scale if scale > 1e-3 else 0.0
            for i in range(3):
                trial[k, i] = found[k, i] + scale * step[i]
    return found, distances


@bare_kernel
def landmark_rows_kernel(
    T: Array, i: int, landmarks: Pair, k: int, measured: Array, n: int, sensor: Pair, work: Work
) -> None:
    """Write the whitened error to column 9 of rows (3, 10), its Jacobian of q to columns 6 to 8.

    It is the error of measurement n of landmark k, of coordinates q, from the pose i: numbers,
    because slices of arrays cost more than the arithmetic. Landmarks are charts and coordinates,
    the sensor a camera and what whitens each error (n, 3, 3). Work is h (3,), the point in the
    camera's frame, times the inverse depth in the chart, the Jacobian by_h (3, 3) of the error by
    h, and rows. Behind the camera there is a large constant error without Jacobians, as in GTSAM's
    own stereo factor; a NaN stays one.
    """
    (charts, coordinates), (camera, whitening), (h, by_h, rows) = landmarks, sensor, work
    fx, fy, cx, cy, baseline = camera[0], camera[1], camera[2], camera[3], camera[4]
    dx, dy = charts[k, 0, 3] - T[i, 0, 3], charts[k, 1, 3] - T[i, 1, 3]
    ahead = dx, dy, charts[k, 2, 3] - T[i, 2, 3]
    q2 = coordinates[k, 2]
    # All that is read before anything is written stays in registers.
    h0, j00, j01, j02 = _seen_kernel(T, i, 0, charts, coordinates, k, ahead)
    h1, j10, j11, j12 = _seen_kernel(T, i, 1, charts, coordinates, k, ahead)
    h2, j20, j21, j22 = _seen_kernel(T, i, 2, charts, coordinates, k, ahead)
    h[0], h[1], h[2] = h0, h1, h2
    inverse, u, v, disparity = 0.0, 2 * fx, 2 * fx, 2 * fx
    x, y = 0.0, 0.0
    if not h2 <= 0:
        inverse = 1 / h2
        x, y = h0 * inverse, h1 * inverse
        u, v = fx * x + cx - measured[n, 0], fy * y + cy - measured[n, 1]
        disparity = fx * baseline * q2 * inverse - measured[n, 2]
    by_u, by_v, by_disparity = fx * inverse, fy * inverse, fx * baseline * inverse
    for r in range(3):
        w0, w1, w2 = whitening[n, r, 0], whitening[n, r, 1], whitening[n, r, 2]
        a, b, c = w0 * by_u, w1 * by_v, w2 * by_disparity
        by_ahead = -a * x - b * y - c * q2 * inverse
        by_h[r, 0], by_h[r, 1], by_h[r, 2] = a, b, by_ahead
        rows[r, 9] = w0 * u + w1 * v + w2 * disparity
        rows[r, 6] = a * j00 + b * j10 + by_ahead * j20
        rows[r, 7] = a * j01 + b * j11 + by_ahead * j21
        rows[r, 8] = a * j02 + b * j12 + by_ahead * j22 + c


@bare_kernel
def _seen_kernel(
    T: Array,
    i: int,
    axis: int,
    charts: Array,
    coordinates: Array,
    k: int,
    d: tuple[float, float, float],
) -> tuple[float, float, float, float]:
    """Compute one entry of h, and its derivatives with respect to q; d is from camera to chart."""
    a, b, c = T[i, 0, axis], T[i, 1, axis], T[i, 2, axis]
    by_q0 = a * charts[k, 0, 0] + b * charts[k, 1, 0] + c * charts[k, 2, 0]
    by_q1 = a * charts[k, 0, 1] + b * charts[k, 1, 1] + c * charts[k, 2, 1]
    by_q2 = a * d[0] + b * d[1] + c * d[2]
    ahead = a * charts[k, 0, 2] + b * charts[k, 1, 2] + c * charts[k, 2, 2]
    q0, q1, q2 = coordinates[k, 0], coordinates[k, 1], coordinates[k, 2]
    return ahead + by_q0 * q0 + by_q1 * q1 + by_q2 * q2, by_q0, by_q1, by_q2


@bare_kernel
def prior_rows_kernel(T: Array, landmarks: Pair, k: int, known: Known, n: int, work: Work) -> None:
    """Write the error root ((x / z, y / z, 1 / z)(T) - seen) + offset and its derivatives.

    Of the prior number n, from its view T[n]. Known are seen (P, 3), root (P, 3, 3),
    offset (P, 3), and the unit camera (1, 1, 0, 0, 1), of focal length and baseline one, which
    measures just these coordinates. The others are those of `landmark_rows_kernel`.
    """
    (seen, root, offset, unit), rows = known, work[2]
    landmark_rows_kernel(T, n, landmarks, k, seen, n, (unit, root), work)
    for r in range(3):
        rows[r, 9] += offset[n, r]


@bare_kernel
def pose_rows_kernel(
    inverse_depth: float, h: Array, by_h: Array, weight: float, rows: Array
) -> None:
    """Write the Jacobian of the pose to columns 0 to 5 of rows, and weight the squares of all.

    The others are those that `landmark_rows_kernel` wrote.
    """
    scale = np.sqrt(weight)
    for i in range(3):
        a, b, c = by_h[i, 0], by_h[i, 1], by_h[i, 2]
        rows[i, 0], rows[i, 1] = b * h[2] - c * h[1], c * h[0] - a * h[2]
        rows[i, 2] = a * h[1] - b * h[0]
        q2 = -inverse_depth
        rows[i, 3], rows[i, 4], rows[i, 5] = q2 * a, q2 * b, q2 * c
        for j in range(10):
            rows[i, j] *= scale


@bare_kernel
def _add_prior_kernel(
    T: Array, landmarks: Pair, k: int, known: Known, n: int, work: Work, system: Array
) -> None:
    """Add the squared error of the prior number n, see `_add_measurement_kernel`."""
    prior_rows_kernel(T, landmarks, k, known, n, work)
    rows = work[2]
    system[6, 0] += 0.5 * (rows[0, 9] ** 2 + rows[1, 9] ** 2 + rows[2, 9] ** 2)
    _add_square_kernel(rows, 1.0, 0.0, system)


@bare_kernel
def _add_measurement_kernel(
    rows: Array, n: int, weights: Array, loss: Array, system: Array, distances: Array
) -> None:
    """Add [AᵀA Aᵀe] (3, 4) of reweighted least squares, what Newton's method adds, and the cost.

    The second is the second derivative of the loss along the error, less the weight. The norm of
    the error is written to `distances`.
    """
    square = rows[0, 9] ** 2 + rows[1, 9] ** 2 + rows[2, 9] ** 2
    distances[n] = np.sqrt(square)
    cost, weight, second = loss_kernel(square, loss)
    system[6, 0] += weights[n] * cost
    along = weights[n] * (second - weight) / square if second < weight else 0.0
    _add_square_kernel(rows, weights[n] * weight, along, system)


@bare_kernel
def _add_square_kernel(rows: Array, weight: float, along: float, system: Array) -> None:
    """Add the weighted [AᵀA Aᵀe] of three rows, and `along` times Aᵀe eᵀA to what Newton's adds."""
    e, f, g = rows[0, 9], rows[1, 9], rows[2, 9]
    a0, b0, c0 = rows[0, 6], rows[1, 6], rows[2, 6]
    a1, b1, c1 = rows[0, 7], rows[1, 7], rows[2, 7]
    a2, b2, c2 = rows[0, 8], rows[1, 8], rows[2, 8]
    x, y, z = a0 * e + b0 * f + c0 * g, a1 * e + b1 * f + c1 * g, a2 * e + b2 * f + c2 * g
    system[0, 0] += weight * (a0 * a0 + b0 * b0 + c0 * c0)
    system[1, 0] += weight * (a1 * a0 + b1 * b0 + c1 * c0)
    system[1, 1] += weight * (a1 * a1 + b1 * b1 + c1 * c1)
    system[2, 0] += weight * (a2 * a0 + b2 * b0 + c2 * c0)
    system[2, 1] += weight * (a2 * a1 + b2 * b1 + c2 * c1)
    system[2, 2] += weight * (a2 * a2 + b2 * b2 + c2 * c2)
    system[0, 3] += weight * x
    system[1, 3] += weight * y
    system[2, 3] += weight * z
    if along != 0:
        system[3, 0] += along * x * x
        system[4, 0] += along * y * x
        system[4, 1] += along * y * y
        system[5, 0] += along * z * x
        system[5, 1] += along * z * y
        system[5, 2] += along * z * z


@bare_kernel
def _step_kernel(system: Array, plain: Array, newton: Array, step: Array) -> float:
    """Write Newton's step (3,), and return its squared length in standard deviations.

    Where that is not well determined, it is the step of reweighted least squares, and zero along
    what that does not determine. `plain` and `newton` (3, 3) are written, too.
    """
    for i in range(3):
        for j in range(i + 1):
            plain[i, j], newton[i, j] = system[i, j], system[i, j] + system[3 + i, j]
    _factorize_kernel(plain)
    _factorize_kernel(newton)
    convex = True
    for i in range(3):
        convex = convex and newton[i, i] >= 0.01 * plain[i, i]
    factors, length = newton if convex else plain, 0.0
    for i in range(3):
        step[i] = -system[i, 3]
        for j in range(i):
            step[i] -= factors[i, j] * step[j]
    for i in range(2, -1, -1):
        step[i] = step[i] / factors[i, i] if factors[i, i] > 0 else 0.0
        for j in range(i + 1, 3):
            step[i] -= factors[j, i] * step[j]
        length -= step[i] * system[i, 3]
    return length


@bare_kernel
def _factorize_kernel(A: Array) -> None:
    """L and D of L D Lᵀ, in place of the lower triangle of A (3, 3); L is zero below no pivot."""
    for i in range(3):
        inverse = 1 / A[i, i] if A[i, i] > 0 else 0.0
        for k in range(i + 1, 3):
            for j in range(i + 1, k + 1):
                A[k, j] -= inverse * A[k, i] * A[j, i]
        for k in range(i + 1, 3):
            A[k, i] *= inverse
