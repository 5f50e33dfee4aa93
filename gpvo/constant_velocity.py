"""The inner loop of fast MC-RANSAC: many constant velocities tried on many tracklet segments."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def moved_points(points: Array, dt: Array, velocity: Array) -> Array:
    """Where static points (N, 3) are in the camera frame after dt (N,): Exp(-dt v) p."""
    moved = np.empty_like(points)
    for i in range(len(points)):
        moved[i] = _move(points[i, 0], points[i, 1], points[i, 2], dt[i], velocity)
    return moved


@njit(cache=True)
def _move(x: float, y: float, z: float, dt: float, velocity: Array) -> tuple[float, float, float]:
    """Exp(-dt v) p = C p + J rho, with C and J as series in the cross product by phi = -dt omega.

    C p + J rho = p + rho + phi x (a p + b rho) + phi x (phi x (b p + c rho)).
    """
    fx, fy, fz = -dt * velocity[0], -dt * velocity[1], -dt * velocity[2]
    rx, ry, rz = -dt * velocity[3], -dt * velocity[4], -dt * velocity[5]
    a, b, c = _rotation_series(fx * fx + fy * fy + fz * fz)
    sx, sy, sz = b * x + c * rx, b * y + c * ry, b * z + c * rz
    ox = a * x + b * rx + fy * sz - fz * sy
    oy = a * y + b * ry + fz * sx - fx * sz
    oz = a * z + b * rz + fx * sy - fy * sx
    return (
        x + rx + fy * oz - fz * oy,
        y + ry + fz * ox - fx * oz,
        z + rz + fx * oy - fy * ox,
    )


@njit(cache=True)
def _rotation_series(squared_angle: float) -> tuple[float, float, float]:
    """sin(w)/w, (1 - cos w)/w^2 and (w - sin w)/w^3 of the squared angle w^2."""
    s = squared_angle
    if s < 0.1:  # the next term of each series is below 1e-16 here
        a = 1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110 * (1 - s / 156)))))
        b = 0.5 * (1 - s / 12 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90 * (1 - s / 132)))))
        c = (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110 * (1 - s / 156))))) / 6
        return a, b, c
    angle = np.sqrt(s)
    return np.sin(angle) / angle, (1 - np.cos(angle)) / s, (angle - np.sin(angle)) / (angle * s)


@njit(cache=True)
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
    """Velocity (6,) of the sample that explains most segments; zero if all are degenerate.

    Stops early once a sample without outliers was drawn with the given confidence; at confidence
    1 all samples are tried. `camera` is (fx, fy, cx, cy, fx * baseline).
    """
    best_velocity, most = np.zeros(6), 0
    needed = len(samples)
    for trial in range(len(samples)):
        if trial >= needed:
            break
        solved, velocity = sample_velocity(points, displacements, dt, samples[trial])
        if not solved:
            continue
        count = _count_inliers(points, dt, later, tolerance, camera, velocity, most)
        if count > most:
            best_velocity, most = velocity, count
            needed = _samples_needed(most / len(points), samples.shape[1], confidence)
    return best_velocity


@njit(cache=True)
def _samples_needed(inlier_ratio: float, sample_size: int, confidence: float) -> float:
    all_inliers = inlier_ratio**sample_size
    if confidence >= 1 or all_inliers <= 0:
        return np.inf
    return np.log(1 - confidence) / np.log(1 - min(all_inliers, 1 - 1e-12))


@njit(cache=True)
def sample_velocity(
    points: Array, displacements: Array, dt: Array, sample: NDArray[np.int64]
) -> tuple[bool, Array]:
    """Linear least-squares velocity (6,) of a sample, and whether it is determined.

    The paper's closed form: d = dt D v with D = [p^, -1] in this convention.
    """
    normal, right = np.zeros((6, 6)), np.zeros(6)
    design = np.zeros((3, 6))
    for i in sample:
        x, y, z = points[i] * dt[i]
        design[0, 1], design[0, 2], design[0, 3] = -z, y, -dt[i]
        design[1, 0], design[1, 2], design[1, 4] = z, -x, -dt[i]
        design[2, 0], design[2, 1], design[2, 5] = -y, x, -dt[i]
        for row in range(3):
            for j in range(6):
                right[j] += design[row, j] * displacements[i, row]
                for k in range(j + 1):
                    normal[j, k] += design[row, j] * design[row, k]
    return _solve_cholesky(normal, right)


@njit(cache=True)
def _solve_cholesky(lower: Array, right: Array) -> tuple[bool, Array]:
    """Solve A x = b from the lower triangle of A, in place; False if A is nearly singular."""
    size = len(right)
    for j in range(size):
        pivot = lower[j, j]
        for k in range(j):
            pivot -= lower[j, k] ** 2
        if not pivot > 1e-9 * lower[j, j]:
            return False, right
        lower[j, j] = np.sqrt(pivot)
        for i in range(j + 1, size):
            for k in range(j):
                lower[i, j] -= lower[i, k] * lower[j, k]
            lower[i, j] /= lower[j, j]
    for i in range(size):
        for k in range(i):
            right[i] -= lower[i, k] * right[k]
        right[i] /= lower[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= lower[k, i] * right[k]
        right[i] /= lower[i, i]
    return True, right


@njit(cache=True)
def _count_inliers(
    points: Array,
    dt: Array,
    later: Array,
    tolerance: Array,
    camera: Array,
    velocity: Array,
    most: int,
) -> int:
    """Number of segments within tolerance; gives up once it cannot exceed `most`."""
    count = 0
    for i in range(len(points)):
        if count + len(points) - i <= most:
            break
        x, y, z = _move(points[i, 0], points[i, 1], points[i, 2], dt[i], velocity)
        if z <= 0:
            continue
        u = camera[0] * x / z + camera[2] - later[i, 0]
        v = camera[1] * y / z + camera[3] - later[i, 1]
        disparity = camera[4] / z - later[i, 2]
        if u * u + v * v + disparity * disparity <= tolerance[i] ** 2:
            count += 1
    return count
