"""Factors of one body velocity that explains a segment of a tracklet, section III-B.

Between the times of two measurements of a landmark the camera moves by Exp(dt v). A point p of the
earlier camera frame is at Exp(dt v)^-1 p in the later one.
"""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    Pose,
    checked_duration,
    checked_key,
    checked_noise,
    checked_vector,
)
from factors.factor import Factor
from factors.kernels.compiled import kernel
from factors.kernels.se3 import (
    RIGHT,
    Array,
    exp_kernel,
    jacobian_coefficients_kernel,
    se3_polynomial_kernel,
)
from factors.lie import skew
from factors.mounting import camera_by_body, checked_mounting
from factors.stereo import (
    Camera,
    StereoCamera,
    StereoMeasurement,
    as_camera,
    reprojection_kernel,
    stereo_measurement,
)
from factors.variables import TWIST, Variable


class EuclideanVelocityFactor(Factor):
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
    T_body_cam
        (4, 4) pose of the camera in the body that has the twist, or gtsam.Pose3; by default they
        are the same.

    Raises
    ------
    ValueError
        If a point is not three finite numbers or dt is not positive.
    """

    measured: Array
    point: Array
    dt: float

    def __init__(
        self,
        measured: ArrayLike,
        model: gtsam.noiseModel.Base,
        velocity: int,
        point: ArrayLike,
        dt: float,
        T_body_cam: Pose | None = None,
    ) -> None:
        checked_noise(model, 3)
        velocity = checked_key("velocity", velocity)
        start, dt = checked_vector("point", point, 3), checked_duration(dt)
        end = checked_vector("measured", measured, 3)
        mounted, offset = checked_mounting(T_body_cam), start - end
        by_velocity = dt * np.hstack([skew(start), -np.eye(3)]) @ camera_by_body(mounted)

        def error(values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
            difference: Array = offset + by_velocity @ values.atVector6(velocity)
            if jacobians is not None:
                jacobians[0] = by_velocity
            return difference

        made_of = {
            "measured": end,
            "model": model,
            "velocity": velocity,
            "point": start,
            "dt": dt,
            "T_body_cam": mounted,
        }
        super().__init__(model, [Variable("velocity", velocity, TWIST)], error, made_of)


@kernel
def _reprojection_kernel(
    velocity: Array, by_body: Array, point: Array, dt: float, measured: Array, camera: Array
) -> Array:
    """Compute the Jacobian of the error by the body's velocity, then the error, (3, 7)."""
    xi = np.zeros(6)
    for i in range(6):
        for j in range(6):
            xi[i] += dt * by_body[i, j] * velocity[j]
    right = se3_polynomial_kernel(xi, jacobian_coefficients_kernel(xi, RIGHT))
    stereo = reprojection_kernel(exp_kernel(xi), point, measured, camera)
    result = np.zeros((3, 7))
    for i in range(3):
        result[i, 6] = stereo[i, 9]
        for j in range(6):
            by_velocity = 0.0
            for k in range(6):
                by_velocity += dt * stereo[i, k] * right[k, j]
            for k in range(6):
                result[i, k] += by_velocity * by_body[j, k]
    return result


class ReprojectionVelocityFactor(Factor):
    """Reprojection of a point of the earlier camera frame to the later one: equation (iter_err).

    Parameters
    ----------
    measured
        (u_left, v, disparity) at the later time, in rectified pixels; or gtsam.StereoPoint2.
    model
        Noise model of dimension 3: of (u_left, v, disparity), or of (u_left, u_right, v) if
        measured is a StereoPoint2.
    velocity
        Key of the body twist (6,), rotation first.
    point
        (3,) the point in the earlier camera frame, metres, in front of the camera.
    dt
        Seconds from the earlier to the later time, positive.
    camera
        Intrinsics of the rectified pair; or gtsam.Cal3_S2Stereo.
    T_body_cam
        (4, 4) pose of the left camera in the body that has the twist, or gtsam.Pose3; by default
        they are the same.

    Raises
    ------
    ValueError
        If the measurement or the point is not three finite numbers, the point is behind the
        camera, or dt is not positive.
    """

    measured: Array
    point: Array
    dt: float
    camera: StereoCamera

    def __init__(
        self,
        measured: StereoMeasurement,
        model: gtsam.noiseModel.Base,
        velocity: int,
        point: ArrayLike,
        dt: float,
        camera: Camera,
        T_body_cam: Pose | None = None,
    ) -> None:
        measurement, noise = stereo_measurement(measured, model)
        velocity = checked_key("velocity", velocity)
        start, dt = checked_vector("point", point, 3), checked_duration(dt)
        if start[2] <= 0:
            raise ValueError(f"point must be in front of the camera, not {start}")
        camera = as_camera(camera)
        mounted, parameters = checked_mounting(T_body_cam), camera.parameters
        by_body = camera_by_body(mounted)

        def error(values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
            v = values.atVector6(velocity)
            result = _reprojection_kernel(v, by_body, start, dt, measurement, parameters)
            if jacobians is not None:
                jacobians[0] = result[:, :6]
            return result[:, 6]

        made_of = {
            "measured": measurement,
            "model": noise,
            "velocity": velocity,
            "point": start,
            "dt": dt,
            "camera": camera,
            "T_body_cam": mounted,
        }
        super().__init__(noise, [Variable("velocity", velocity, TWIST)], error, made_of)
