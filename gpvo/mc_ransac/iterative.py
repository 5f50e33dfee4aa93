"""Iterative MC-RANSAC, section III-B.2: a velocity refined by Gauss-Newton on its inliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_positive_definite, checked_vector
from factors.kernels.se3 import (
    LEFT,
    jacobian_coefficients_kernel,
    kernel,
    product_kernel,
    se3_polynomial_kernel,
)
from factors.lie import se3_exp, se3_left_jacobian, skew
from factors.stereo import StereoCamera
from gpvo.config import McRansacConfig
from gpvo.mc_ransac.fast_kernels import move, moved_points
from gpvo.mc_ransac.segments import Segments, are_inliers

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VelocityFit:
    """Velocity found by MC-RANSAC, its covariance and its inliers.

    Attributes
    ----------
    velocity
        (6,) body twist, rotation first, rad/s and m/s.
    covariance
        (6, 6) of the velocity, if both measurements of a segment have the given noise.
    inliers
        (N,) bool, which segments the velocity explains.
    """

    velocity: Array
    covariance: Array
    inliers: NDArray[np.bool_]


def iterative_mc_ransac(
    segments: Segments,
    camera: StereoCamera,
    information: ArrayLike,
    velocity: ArrayLike,
    inliers: NDArray[np.bool_],
    config: McRansacConfig,
) -> VelocityFit | None:
    """Refine a velocity by Gauss-Newton on its inliers and select them again, section III-B.2.

    This is done up to `config.refinements` times, because a refined velocity explains more
    segments. `information` is R^-1 of a measurement, (3, 3) or its diagonal (3,). Returns None if
    the inliers do not determine a velocity.

    Raises
    ------
    ValueError
        If the information, the velocity or the inliers have another shape or are not finite.
    """
    information = checked_positive_definite("information", information, 3)
    velocity = checked_vector("velocity", velocity, 6)
    inliers = np.asarray(inliers)
    if inliers.dtype != bool or inliers.shape != (len(segments),):
        raise ValueError(f"inliers must be one truth value for each of {len(segments)} segments")
    for _ in range(config.refinements):
        chosen = segments[inliers]
        refined = _refined_velocity(chosen, camera, information, velocity, config)
        if refined is None:
            return None
        velocity, before = refined, inliers
        inliers = are_inliers(segments, camera, velocity, config)
        if (inliers == before).all() or inliers.sum() < config.sample_size:
            break
    covariance = velocity_covariance(chosen, camera, information, velocity)
    return VelocityFit(velocity, covariance, inliers)


def _refined_velocity(
    segments: Segments,
    camera: StereoCamera,
    information: Array,
    velocity: Array,
    config: McRansacConfig,
) -> Array | None:
    """Minimize the weighted reprojection errors, or return None if the velocity is undetermined."""
    points = camera.triangulate(segments.earlier)
    for _ in range(config.refinement_iterations):
        normal, right = normal_equations(
            points, segments.dt, segments.later, velocity, information, camera.parameters
        )
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > config.max_condition:
            return None
        step = np.linalg.solve(normal, right)
        velocity = velocity - step
        if np.abs(step).max() < config.refinement_tolerance:
            break
    return velocity


def reprojection_error(
    segments: Segments, camera: StereoCamera, velocity: Array
) -> tuple[Array, Array]:
    """Compute the reprojection error (N, 3) and its Jacobian with respect to velocity, (N, 3, 6).

    The error is the predicted minus the measured later measurement: equation (iter_err) with the
    opposite sign, so that the Jacobian is that of the prediction.
    """
    points = moved_points(camera.triangulate(segments.earlier), segments.dt, velocity)
    predicted, by_point = camera.project_with_jacobian(points)
    step = -segments.dt[:, None] * velocity
    by_twist = np.concatenate([-skew(points), np.broadcast_to(np.eye(3), (len(points), 3, 3))], 2)
    by_velocity = -segments.dt[:, None, None] * (by_twist @ se3_left_jacobian(step))
    return predicted - segments.later, by_point @ by_velocity


def velocity_covariance(
    segments: Segments, camera: StereoCamera, information: Array, velocity: Array
) -> Array:
    """Compute the covariance (6, 6) of the velocity that minimizes the reprojection errors.

    The cost weights errors by R^-1. However, they have the noise of both measurements: R of the
    later one, and R propagated through the prediction of the earlier one.
    """
    _, by_velocity = reprojection_error(segments, camera, velocity)
    by_earlier = _prediction_by_earlier(segments, camera, velocity)
    R = np.linalg.inv(information)
    noise = R + by_earlier @ R @ by_earlier.transpose(0, 2, 1)
    weighted = np.einsum("nij,ik->njk", by_velocity, information)
    gain = np.linalg.solve(np.einsum("nij,njk->ik", weighted, by_velocity), weighted)
    return np.einsum("nij,njk,nlk->il", gain, noise, gain)


def _prediction_by_earlier(segments: Segments, camera: StereoCamera, velocity: Array) -> Array:
    """Compute the Jacobian of the prediction with respect to the earlier measurement, (N, 3, 3)."""
    points = camera.triangulate(segments.earlier)
    rotation = se3_exp(-segments.dt[:, None] * velocity)[:, :3, :3]
    _, by_moved = camera.project_with_jacobian(moved_points(points, segments.dt, velocity))
    _, by_point = camera.project_with_jacobian(points)
    return by_moved @ rotation @ np.linalg.inv(by_point)


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
        u, v, disparity = camera[0] / z, camera[1] / z, camera[0] * camera[4] / z
        error[0] = camera[0] * x / z + camera[2] - later[n, 0]
        error[1] = camera[1] * y / z + camera[3] - later[n, 1]
        error[2] = disparity - later[n, 2]
        _by_twist(by_twist, x, y, z, u, v, disparity)
        step = -dt[n] * velocity
        jacobian = se3_polynomial_kernel(step, jacobian_coefficients_kernel(step, LEFT))
        by_velocity = -dt[n] * product_kernel(by_twist, jacobian)
        weighted = product_kernel(information, by_velocity)
        _add_products(weighted, by_velocity, error, normal, right)
    for j in range(6):
        normal[:j, j] = normal[j, :j]
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
def _by_twist(
    by_twist: Array, x: float, y: float, z: float, u: float, v: float, disparity: float
) -> None:
    """Write the Jacobian of the prediction at Exp(twist) p with respect to the twist, (3, 6)."""
    by_twist[0] = (-u * x * y / z, u * (z + x * x / z), -u * y, u, 0.0, -u * x / z)
    by_twist[1] = (-v * (z + y * y / z), v * x * y / z, v * x, 0.0, v, -v * y / z)
    by_twist[2] = (-disparity * y / z, disparity * x / z, 0.0, 0.0, 0.0, -disparity / z)
