"""Factors of one body velocity that explains a segment of a tracklet, section III-B.

Between the times of two measurements of a landmark the camera moves by Exp(dt v). A point p of the
earlier camera frame is at Exp(dt v)^-1 p in the later one.
"""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_duration, checked_noise, checked_vector
from factors.kernels import (
    RIGHT,
    Array,
    exp_kernel,
    jacobian_coefficients_kernel,
    kernel,
    se3_polynomial_kernel,
)
from factors.lie import skew
from factors.stereo import StereoCamera, checked_measurement, reprojection_kernel


def EuclideanVelocityFactor(
    measured: ArrayLike, model: gtsam.noiseModel.Base, velocity: int, point: ArrayLike, dt: float
) -> gtsam.CustomFactor:
    """Motion of a point in the camera frame, to first order in dt: equation (fast_err_new).

    The error (1 - dt v^) point - measured is linear in the velocity, so that one step of
    Gauss-Newton is the closed form of the paper.

    Parameters
    ----------
    measured
        (3,) the point in the later camera frame, metres.
    model
        Noise model of dimension 3.
    velocity
        Key of the body twist (6,), rotation first.
    point
        (3,) the point in the earlier camera frame, metres.
    dt
        Seconds from the earlier to the later time, positive.

    Raises
    ------
    ValueError
        If a point is not three finite numbers or dt is not positive.
    """
    checked_noise(model, 3)
    start, dt = checked_vector("point", point, 3), checked_duration(dt)
    offset = start - checked_vector("measured", measured, 3)
    by_velocity = dt * np.hstack([skew(start), -np.eye(3)])

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        if jacobians is not None:
            jacobians[0] = by_velocity
        return offset + by_velocity @ values.atVector(velocity)

    return gtsam.CustomFactor(model, [velocity], error)


@kernel
def _reprojection_kernel(
    velocity: Array, point: Array, dt: float, measured: Array, camera: Array
) -> Array:
    """Compute the Jacobian of the error with respect to velocity, then the error, (3, 7)."""
    xi = np.empty(6)
    for i in range(6):
        xi[i] = dt * velocity[i]
    right = se3_polynomial_kernel(xi, jacobian_coefficients_kernel(xi, RIGHT))
    stereo = reprojection_kernel(exp_kernel(xi), point, measured, camera)
    result = np.zeros((3, 7))
    for i in range(3):
        result[i, 6] = stereo[i, 9]
        for j in range(6):
            for k in range(6):
                result[i, j] += dt * stereo[i, k] * right[k, j]
    return result


def ReprojectionVelocityFactor(
    measured: ArrayLike,
    model: gtsam.noiseModel.Base,
    velocity: int,
    point: ArrayLike,
    dt: float,
    camera: StereoCamera,
) -> gtsam.CustomFactor:
    """Reprojection of a point of the earlier camera frame to the later one: equation (iter_err).

    Parameters
    ----------
    measured
        (u_left, v, disparity) at the later time, in rectified pixels.
    model
        Noise model of dimension 3.
    velocity
        Key of the body twist (6,), rotation first.
    point
        (3,) the point in the earlier camera frame, metres, in front of the camera.
    dt
        Seconds from the earlier to the later time, positive.
    camera
        Intrinsics of the rectified pair.

    Raises
    ------
    ValueError
        If the measurement or the point is not three finite numbers, the point is behind the
        camera, or dt is not positive.
    """
    checked_noise(model, 3)
    start, dt = checked_vector("point", point, 3), checked_duration(dt)
    if start[2] <= 0:
        raise ValueError(f"point must be in front of the camera, not {start}")
    measurement, parameters = checked_measurement(measured), camera.parameters

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        result = _reprojection_kernel(values.atVector(velocity), start, dt, measurement, parameters)
        if jacobians is not None:
            jacobians[0] = result[:, :6]
        return result[:, 6]

    return gtsam.CustomFactor(model, [velocity], error)
