"""The plain formulas of iterative MC-RANSAC, which its kernels are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_exp, se3_left_jacobian, skew
from factors.stereo import StereoCamera
from gpvo.mc_ransac import Segments
from gpvo.mc_ransac.moved_points import moved_points

Array = NDArray[np.float64]


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
    by_earlier = prediction_by_earlier(segments, camera, velocity)
    R = np.linalg.inv(information)
    noise = R + by_earlier @ R @ by_earlier.transpose(0, 2, 1)
    weighted = np.einsum("nij,ik->njk", by_velocity, information)
    gain = np.linalg.solve(np.einsum("nij,njk->ik", weighted, by_velocity), weighted)
    return np.einsum("nij,njk,nlk->il", gain, noise, gain)


def prediction_by_earlier(segments: Segments, camera: StereoCamera, velocity: Array) -> Array:
    """Compute the Jacobian of the prediction with respect to the earlier measurement, (N, 3, 3)."""
    points = camera.triangulate(segments.earlier)
    rotation = se3_exp(-segments.dt[:, None] * velocity)[:, :3, :3]
    _, by_moved = camera.project_with_jacobian(moved_points(points, segments.dt, velocity))
    _, by_point = camera.project_with_jacobian(points)
    return by_moved @ rotation @ np.linalg.inv(by_point)
