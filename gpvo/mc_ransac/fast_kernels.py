"""Inner loop of fast MC-RANSAC: many constant velocities tried on many tracklet segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.mc_ransac.moved_points import HALF_TURN, half_turn_series, move, move_by_series

Array = NDArray[np.float64]

BLOCK = 32
"""Number of segments tested at once, in vector registers; the count may end after each block."""


@kernel
def best_sample_velocity(
    points: Array,
    displacements: Array,
    dt: Array,
    later: Array,
    tolerance: Array,
    samples: NDArray[np.int64],
    camera: Array,
    confidence: float,
) -> Array:
    """Find the velocity (6,) of the sample that explains most segments; 0 if all are degenerate.

    Sampling stops once a sample without outliers was drawn with the given confidence. At confidence
    1 all samples are tried. `camera` is (fx, fy, cx, cy, baseline).
    """
    columns = _columns(points, dt, later, tolerance)
    best_velocity, most = np.zeros(6), 0
    needed = len(samples)
    for trial in range(len(samples)):
        if trial >= needed:
            break
        solved, velocity = sample_velocity(points, displacements, dt, samples[trial])
        if not solved:
            continue
        count = _count_inliers(columns, camera, velocity, most)
        if count > most:
            best_velocity, most = velocity, count
            needed = _samples_needed(most / len(points), samples.shape[1], confidence)
    return best_velocity


@kernel
def _columns(points: Array, dt: Array, later: Array, tolerance: Array) -> Array:
    """Return points, later measurements, dt and squared tolerance, (8, N).

    Each quantity is contiguous, so that a block of segments fills vector registers.
    """
    columns = np.empty((8, len(points)))
    for i in range(len(points)):
        for k in range(3):
            columns[k, i], columns[3 + k, i] = points[i, k], later[i, k]
        columns[6, i], columns[7, i] = dt[i], tolerance[i] ** 2
    return columns


@kernel
def _samples_needed(inlier_ratio: float, sample_size: int, confidence: float) -> float:
    all_inliers = inlier_ratio**sample_size
    if confidence >= 1 or all_inliers <= 0:
        return np.inf
    return np.log(1 - confidence) / np.log(1 - min(all_inliers, 1 - 1e-12))


@kernel
def sample_velocity(
    points: Array, displacements: Array, dt: Array, sample: NDArray[np.int64]
) -> tuple[bool, Array]:
    """Compute the linear least-squares velocity (6,) of a sample, and whether it is determined.

    The paper's closed form: d = dt D v with D = [p^, -1] in this convention. The linear velocity is
    eliminated: the equations about the centroid of the points, weighted by dt^2, contain the
    angular velocity alone.
    """
    weight, p, d = 0.0, np.zeros(3), np.zeros(3)
    for i in sample:
        weight += dt[i] ** 2
        for k in range(3):
            p[k] += dt[i] ** 2 * points[i, k]
            d[k] += dt[i] * displacements[i, k]
    p, d = p / weight, d / weight  # the centroid and its velocity
    xx = yy = zz = xy = xz = yz = bx = by = bz = 0.0
    for i in sample:
        x, y, z = points[i, 0] - p[0], points[i, 1] - p[1], points[i, 2] - p[2]
        u, v, w = displacements[i] * dt[i]
        bx += v * z - w * y
        by += w * x - u * z
        bz += u * y - v * x
        x, y, z = dt[i] * x, dt[i] * y, dt[i] * z
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    solved, ox, oy, oz = _solve_inertia((xx, yy, zz, xy, xz, yz), (bx, by, bz))
    velocity = np.empty(6)
    velocity[0], velocity[1], velocity[2] = ox, oy, oz
    velocity[3] = p[1] * oz - p[2] * oy - d[0]
    velocity[4] = p[2] * ox - p[0] * oz - d[1]
    velocity[5] = p[0] * oy - p[1] * ox - d[2]
    return solved, velocity


@kernel
def _solve_inertia(
    moments: tuple[float, float, float, float, float, float], right: tuple[float, float, float]
) -> tuple[bool, float, float, float]:
    """Solve A x = b, A = trace(M) 1 - M of second moments M, by Cholesky: A = L D L^T.

    There is no solution if A is nearly singular: points on a line contain no information on the
    rotation about it.
    """
    xx, yy, zz, xy, xz, yz = moments
    d0, d1, d2 = yy + zz, xx + zz, xx + yy
    least = 1e-9 * (d0 + d1 + d2)
    if not d0 > least:
        return False, 0.0, 0.0, 0.0
    l10, l20 = -xy / d0, -xz / d0
    d1 -= l10 * l10 * d0
    if not d1 > least:
        return False, 0.0, 0.0, 0.0
    l21 = (-yz - l20 * l10 * d0) / d1
    d2 -= l20 * l20 * d0 + l21 * l21 * d1
    if not d2 > least:
        return False, 0.0, 0.0, 0.0
    b0 = right[0]
    b1 = right[1] - l10 * b0
    b2 = right[2] - l20 * b0 - l21 * b1
    z = b2 / d2
    y = b1 / d1 - l21 * z
    return True, b0 / d0 - l10 * y - l20 * z, y, z


@kernel
def _count_inliers(columns: Array, camera: Array, velocity: Array, most: int) -> int:
    """Count the segments within tolerance; give up once the count cannot exceed `most`.

    `columns` (8, N) holds points, later measurements, dt and squared tolerance, C-contiguous.
    """
    size = columns.shape[1]
    squared_speed = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2
    half_turns = squared_speed * columns[6].max() ** 2 < HALF_TURN
    count = 0
    for start in range(0, size, BLOCK):
        if count + size - start <= most:
            break
        stop = min(start + BLOCK, size)
        if half_turns:
            count += _count_half_turns(columns, start, stop, camera, velocity)
        else:
            count += _count_turns(columns, start, stop, camera, velocity)
    return count


@kernel
def _count_half_turns(columns: Array, start: int, stop: int, camera: Array, velocity: Array) -> int:
    """Count inliers among some segments, without branches so that it runs in vector registers."""
    squared_speed = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2
    count = 0
    for i in range(start, stop):
        dt = columns[6, i]
        series = half_turn_series(squared_speed * dt * dt)
        x, y, z = columns[0, i], columns[1, i], columns[2, i]
        count += _is_inlier(move_by_series(x, y, z, dt, velocity, series), columns, i, camera)
    return count


@kernel
def _count_turns(columns: Array, start: int, stop: int, camera: Array, velocity: Array) -> int:
    count = 0
    for i in range(start, stop):
        x, y, z = columns[0, i], columns[1, i], columns[2, i]
        count += _is_inlier(move(x, y, z, columns[6, i], velocity), columns, i, camera)
    return count


@kernel
def _is_inlier(
    point: tuple[float, float, float], columns: Array, i: int, camera: Array
) -> np.int64:
    """Return 1 if a point of the camera frame projects near segment i's later measurement, else 0.

    Near is within the segment's tolerance. The result is an integer because vector registers add up
    numbers and not truth values.
    """
    x, y, z = point
    u = camera[0] * x / z + camera[2] - columns[3, i]
    v = camera[1] * y / z + camera[3] - columns[4, i]
    disparity = camera[0] * camera[4] / z - columns[5, i]
    near = u * u + v * v + disparity * disparity <= columns[7, i]
    return np.int64(near & (z > 0))


@kernel
def explained_kernel(
    points: Array, dt: Array, later: Array, tolerance: Array, camera: Array, velocity: Array
) -> NDArray[np.bool_]:
    """Tell which segments (N,) a velocity explains within their tolerances (N,), pixels."""
    columns = _columns(points, dt, later, tolerance)
    explained = np.empty(len(points), np.bool_)
    for i in range(len(points)):
        moved = move(points[i, 0], points[i, 1], points[i, 2], dt[i], velocity)
        explained[i] = _is_inlier(moved, columns, i, camera) > 0
    return explained


@kernel
def distinct_indices(uniform: Array, count: int) -> NDArray[np.int64]:
    """Make indices (M, size) below `count`, distinct within a row, of numbers in [0, 1)."""
    samples = np.empty(uniform.shape, np.int64)
    taken = np.empty(uniform.shape[1], np.int64)  # in order
    for i in range(len(uniform)):
        for k in range(uniform.shape[1]):
            index = int(uniform[i, k] * (count - k))
            place = 0
            while place < k and index >= taken[place]:
                index += 1
                place += 1
            for later in range(k, place, -1):
                taken[later] = taken[later - 1]
            taken[place] = samples[i, k] = index
    return samples
