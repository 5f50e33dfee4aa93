"""Where static points are in the camera frame after a time, at a constant velocity."""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel

Array = NDArray[np.float64]

HALF_TURN = 10.0
"""Squared angle (rad^2) below which rotations use power series, just over pi^2."""
B, C = (tuple(1 / factorial(2 * k + n) for k in range(13)) for n in (2, 3))
"""Coefficients of (1 - cos w)/w^2 and (w - sin w)/w^3 in powers of -w^2."""


@kernel
def moved_points(points: Array, dt: Array, velocity: Array) -> Array:
    """Compute where static points (N, 3) are in the camera frame after dt (N,): Exp(-dt v) p."""
    moved = np.empty_like(points)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        moved[i, 0], moved[i, 1], moved[i, 2] = move(x, y, z, dt[i], velocity)
    return moved


@kernel
def move(x: float, y: float, z: float, dt: float, velocity: Array) -> tuple[float, float, float]:
    """Compute Exp(-dt v) p."""
    fx, fy, fz = -dt * velocity[0], -dt * velocity[1], -dt * velocity[2]
    series = _rotation_series(fx * fx + fy * fy + fz * fz)
    return move_by_series(x, y, z, dt, velocity, series)


@kernel
def move_by_series(
    x: float, y: float, z: float, dt: float, velocity: Array, series: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Compute Exp(-dt v) p = C p + J rho by series in the cross product with phi = -dt omega.

    C p + J rho = p + rho + phi x (a p + b rho) + phi x (phi x (b p + c rho)).
    """
    fx, fy, fz = -dt * velocity[0], -dt * velocity[1], -dt * velocity[2]
    rx, ry, rz = -dt * velocity[3], -dt * velocity[4], -dt * velocity[5]
    a, b, c = series
    sx, sy, sz = b * x + c * rx, b * y + c * ry, b * z + c * rz
    ox = a * x + b * rx + fy * sz - fz * sy
    oy = a * y + b * ry + fz * sx - fx * sz
    oz = a * z + b * rz + fx * sy - fy * sx
    return (
        x + rx + fy * oz - fz * oy,
        y + ry + fz * ox - fx * oz,
        z + rz + fx * oy - fy * ox,
    )


@kernel
def _rotation_series(squared_angle: float) -> tuple[float, float, float]:
    """Compute sin(w)/w, (1 - cos w)/w^2 and (w - sin w)/w^3 from the squared angle w^2."""
    if squared_angle < HALF_TURN:
        return half_turn_series(squared_angle)
    s, angle = squared_angle, np.sqrt(squared_angle)
    return np.sin(angle) / angle, (1 - np.cos(angle)) / s, (angle - np.sin(angle)) / (angle * s)


@kernel
def half_turn_series(s: float) -> tuple[float, float, float]:
    """Compute `_rotation_series` below `HALF_TURN`, without branches and square roots."""
    b = B[8] - s * (B[9] - s * (B[10] - s * (B[11] - s * B[12])))
    b = B[4] - s * (B[5] - s * (B[6] - s * (B[7] - s * b)))
    b = B[0] - s * (B[1] - s * (B[2] - s * (B[3] - s * b)))
    c = C[8] - s * (C[9] - s * (C[10] - s * (C[11] - s * C[12])))
    c = C[4] - s * (C[5] - s * (C[6] - s * (C[7] - s * c)))
    c = C[0] - s * (C[1] - s * (C[2] - s * (C[3] - s * c)))
    return 1.0 - s * c, b, c
