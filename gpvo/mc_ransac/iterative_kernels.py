"""Kernels of iterative MC-RANSAC: Gauss-Newton, and how uncertain its velocity is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from factors.kernels.matrices import product_kernel
from factors.kernels.se3 import (
    LEFT,
    exp_kernel,
    jacobian_coefficients_kernel,
    se3_polynomial_kernel,
)
from factors.kernels.triangular import factorize_kernel, solve_lower_kernel
from gpvo.mc_ransac.moved_points import move

Array = NDArray[np.float64]


@kernel
def fit_kernel(
    points: Array,
    dt: Array,
    later: Array,
    information: Array,
    camera: Array,
    velocity: Array,
    iterations: int,
    tolerance: float,
) -> tuple[Array, Array]:
    """Minimize the weighted reprojection errors by Gauss-Newton; see `normal_equations`.

    It ends after a step of at most the tolerance. Returns the velocity (6,), NaN if it is
    undetermined, and J^T W J (6, 6) before the last step.
    """
    velocity, normal = velocity.copy(), np.zeros((6, 6))
    for _ in range(iterations):
        normal, right = normal_equations(points, dt, later, velocity, information, camera)
        step, largest = _solve(normal, right.reshape(6, 1)), 0.0
        for k in range(6):
            velocity[k] -= step[k, 0]
            largest = max(largest, abs(step[k, 0]))
        if not largest >= tolerance:
            break
    return velocity, normal


@kernel
def _solve(normal: Array, right: Array) -> Array:
    """Solve normal X = right (6, m) by Cholesky; NaN if `normal` is not positive definite."""
    root, x = normal.copy(), right.copy()
    factorize_kernel(root)
    solve_lower_kernel(root, x)
    for i in range(5, -1, -1):
        for j in range(x.shape[1]):
            for k in range(i + 1, 6):
                x[i, j] -= root[k, i] * x[k, j]
            x[i, j] /= root[i, i]
    return x


@kernel
def covariance_kernel(
    points: Array, dt: Array, later: Array, information: Array, camera: Array, velocity: Array
) -> Array:
    """Compute the covariance (6, 6) of the velocity that minimizes the reprojection errors.

    The cost weights errors by W = R^-1. However, they have the noise of both measurements: R of the
    later one, and R propagated through the prediction of the earlier one, Jacobian B:

        (J^T W J)^-1 (J^T W (R + B R B^T) W J) (J^T W J)^-1
    """
    spread, normal = np.zeros((6, 6)), np.zeros((6, 6))
    by_twist, root = np.zeros((3, 6)), information.copy()
    factorize_kernel(root)
    for n in range(len(points)):
        x, y, z = move(points[n, 0], points[n, 1], points[n, 2], dt[n], velocity)
        by_velocity = _by_velocity(by_twist, x, y, z, dt[n], velocity, camera)
        weighted = product_kernel(information, by_velocity)
        # W = L L^T, so that B R B^T = (L^-1 B^T)^T (L^-1 B^T).
        earlier = _by_earlier(points[n], x, y, z, dt[n], velocity, camera).T.copy()
        solve_lower_kernel(root, earlier)
        noise = product_kernel(earlier, weighted)
        spread += product_kernel(noise.T.copy(), noise)
        normal += product_kernel(by_velocity.T.copy(), weighted)
    half = _solve(normal, spread + normal).T.copy()
    return _solve(normal, half).T.copy()


@kernel
def normal_equations(
    points: Array, dt: Array, later: Array, velocity: Array, information: Array, camera: Array
) -> tuple[Array, Array]:
    """Compute J^T W J (6, 6) and J^T W e (6,) of the errors e, predicted minus measured.

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
    by_twist, error = np.zeros((3, 6)), np.empty(3)
    for n in range(len(points)):
        x, y, z = move(points[n, 0], points[n, 1], points[n, 2], dt[n], velocity)
        error[0] = camera[0] * x / z + camera[2] - later[n, 0]
        error[1] = camera[1] * y / z + camera[3] - later[n, 1]
        error[2] = camera[0] * camera[4] / z - later[n, 2]
        by_velocity = _by_velocity(by_twist, x, y, z, dt[n], velocity, camera)
        weighted = product_kernel(information, by_velocity)
        _add_products(weighted, by_velocity, error, normal, right)
    for j in range(6):
        for k in range(j):
            normal[k, j] = normal[j, k]
    return normal, right


@kernel
def _add_products(A: Array, B: Array, e: Array, normal: Array, right: Array) -> None:
    """Add A^T B to the lower triangle of `normal`, and A^T e to `right`."""
    for i in range(3):
        for j in range(6):
            right[j] += A[i, j] * e[i]
            for k in range(j + 1):
                normal[j, k] += A[i, j] * B[i, k]


@kernel
def _by_velocity(
    by_twist: Array, x: float, y: float, z: float, dt: float, velocity: Array, camera: Array
) -> Array:
    """Compute the Jacobian (3, 6) of the prediction at a moved point with respect to velocity."""
    u, v, disparity = camera[0] / z, camera[1] / z, camera[0] * camera[4] / z
    _by_twist(by_twist, x, y, z, u, v, disparity)
    step = -dt * velocity
    jacobian = se3_polynomial_kernel(step, jacobian_coefficients_kernel(step, LEFT))
    return -dt * product_kernel(by_twist, jacobian)


@kernel
def _by_earlier(
    point: Array, x: float, y: float, z: float, dt: float, velocity: Array, camera: Array
) -> Array:
    """Compute the Jacobian (3, 3) of the prediction with respect to the earlier measurement.

    The point was at (x, y, z) in the camera frame dt seconds after the earlier measurement.
    """
    by_moved, by_measurement = np.zeros((3, 3)), np.zeros((3, 3))
    by_moved[0, 0], by_moved[0, 2] = camera[0] / z, -camera[0] * x / (z * z)
    by_moved[1, 1], by_moved[1, 2] = camera[1] / z, -camera[1] * y / (z * z)
    by_moved[2, 2] = -camera[0] * camera[4] / (z * z)
    depth, disparity = point[2], camera[0] * camera[4] / point[2]
    by_measurement[0, 0], by_measurement[1, 1] = depth / camera[0], depth / camera[1]
    for i in range(3):
        by_measurement[i, 2] = -point[i] / disparity
    rotation = exp_kernel(-dt * velocity)[:3, :3].copy()
    return product_kernel(by_moved, product_kernel(rotation, by_measurement))


@kernel
def _by_twist(
    by_twist: Array, x: float, y: float, z: float, u: float, v: float, disparity: float
) -> None:
    """Write the Jacobian of the prediction at Exp(twist) p with respect to the twist, (3, 6)."""
    by_u = -u * x * y / z, u * (z + x * x / z), -u * y, u, 0.0, -u * x / z
    by_v = -v * (z + y * y / z), v * x * y / z, v * x, 0.0, v, -v * y / z
    by_disparity = -disparity * y / z, disparity * x / z, 0.0, 0.0, 0.0, -disparity / z
    for k in range(6):
        by_twist[0, k], by_twist[1, k], by_twist[2, k] = by_u[k], by_v[k], by_disparity[k]
