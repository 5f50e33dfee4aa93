"""The inner loop of iterative MC-RANSAC: normal equations of a constant velocity's errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels import LEFT, jacobian_coefficients_kernel, kernel, polynomial_kernel
from gpvo.constant_velocity import move

Array = NDArray[np.float64]


@kernel
def normal_equations(
    points: Array, dt: Array, later: Array, velocity: Array, information: Array, camera: Array
) -> tuple[Array, Array]:
    """J^T W J (6, 6) and J^T W e (6,) of the errors e, predicted minus measured.

    Parameters
    ----------
    points
        (N, 3) landmarks in the camera at the earlier times.
    dt, later
        (N,) seconds to the later times, and the measurements (N, 3) there.
    velocity
        (6,) body twist.
    information
        (3, 3) weight W of an error.
    camera
        (fx, fy, cx, cy, baseline).
    """
    normal, right = np.zeros((6, 6)), np.zeros(6)
    by_twist, by_velocity, weighted = np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6))
    error = np.empty(3)
    for n in range(len(points)):
        x, y, z = move(points[n, 0], points[n, 1], points[n, 2], dt[n], velocity)
        u, v, disparity = camera[0] / z, camera[1] / z, camera[0] * camera[4] / z
        error[0] = camera[0] * x / z + camera[2] - later[n, 0]
        error[1] = camera[1] * y / z + camera[3] - later[n, 1]
        error[2] = disparity - later[n, 2]
        _by_twist(by_twist, x, y, z, u, v, disparity)
        step = -dt[n] * velocity
        jacobian = polynomial_kernel(step, jacobian_coefficients_kernel(step, LEFT))
        by_velocity[:] = -dt[n] * (by_twist @ jacobian)
        weighted[:] = information @ by_velocity
        normal += weighted.T @ by_velocity
        right += weighted.T @ error
    return normal, right


@kernel
def _by_twist(
    by_twist: Array, x: float, y: float, z: float, u: float, v: float, disparity: float
) -> None:
    """Write the derivative (3, 6) of a prediction by a motion of its point, Exp(twist) p."""
    by_twist[0] = (-u * x * y / z, u * (z + x * x / z), -u * y, u, 0.0, -u * x / z)
    by_twist[1] = (-v * (z + y * y / z), v * x * y / z, v * x, 0.0, v, -v * y / z)
    by_twist[2] = (-disparity * y / z, disparity * x / z, 0.0, 0.0, 0.0, -disparity / z)
