"""A rectified stereo camera, and the reprojection of a landmark into it."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_noise, checked_vector
from factors.jacobian_blocks import JacobianBlocks
from factors.kernels import Array, copy_columns_kernel, kernel, row_major_kernel

_BLOCKS = JacobianBlocks(3, (6, 3))


@dataclass(frozen=True)
class StereoCamera:
    """Intrinsics of a rectified pair: pixels, and the baseline in metres.

    A point (X, Y, Z) of the left camera frame is measured at
    (u_left, v, disparity) = (fx X/Z + cx, fy Y/Z + cy, fx baseline/Z).
    """

    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "baseline"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        if not np.isfinite([self.cx, self.cy]).all():
            raise ValueError(f"cx and cy must be finite, not {self.cx} and {self.cy}")

    @property
    def parameters(self) -> Array:
        """Intrinsics (5,): fx, fy, cx, cy, baseline."""
        return np.array([self.fx, self.fy, self.cx, self.cy, self.baseline])

    def project(self, points: ArrayLike) -> Array:
        """Project points (..., 3) in the left camera frame, Z > 0, to measurements (..., 3)."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        u, v = self.fx * x / z + self.cx, self.fy * y / z + self.cy
        return np.stack([u, v, self.fx * self.baseline / z], axis=-1)

    def project_with_jacobian(self, points: ArrayLike) -> tuple[Array, Array]:
        """Project points (..., 3) to measurements (..., 3) with their Jacobians (..., 3, 3)."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        jacobian = np.zeros((*np.shape(x), 3, 3))
        jacobian[..., 0, 0] = self.fx / z
        jacobian[..., 0, 2] = -self.fx * x / z**2
        jacobian[..., 1, 1] = self.fy / z
        jacobian[..., 1, 2] = -self.fy * y / z**2
        jacobian[..., 2, 2] = -self.fx * self.baseline / z**2
        return self.project(points), jacobian

    def triangulate(self, measurements: ArrayLike) -> Array:
        """Triangulate measurements (..., 3), disparity > 0, to points in the left camera frame."""
        u, v, disparity = np.moveaxis(np.asarray(measurements, np.float64), -1, 0)
        z = self.fx * self.baseline / disparity
        return np.stack([(u - self.cx) * z / self.fx, (v - self.cy) * z / self.fy, z], axis=-1)

    def inverse_depth(self, measurements: ArrayLike) -> Array:
        """Compute x / z, y / z and 1 / z (..., 3) in the left camera frame from measurements."""
        u, v, disparity = np.moveaxis(np.asarray(measurements, np.float64), -1, 0)
        inverse = disparity / (self.fx * self.baseline)
        return np.stack([(u - self.cx) / self.fx, (v - self.cy) / self.fy, inverse], axis=-1)


@kernel
def reprojection_kernel(T: Array, landmark: Array, measured: Array, camera: Array) -> Array:
    """Compute the Jacobian of the error with respect to pose and landmark, then the error, (3, 10).

    The columns are the pose (6), the landmark (3) and the error (1). Behind the camera the error is
    a large constant and the Jacobian is zero, like in GTSAM's own stereo factor.
    """
    fx, fy, cx, cy, baseline = camera[0], camera[1], camera[2], camera[3], camera[4]
    x, y, z = 0.0, 0.0, 0.0
    for j in range(3):
        difference = landmark[j] - T[j, 3]
        x += T[j, 0] * difference
        y += T[j, 1] * difference
        z += T[j, 2] * difference
    result = np.zeros((3, 10))
    if z <= 0:
        for i in range(3):
            result[i, 9] = 2 * fx
        return result
    result[0, 9] = fx * x / z + cx - measured[0]
    result[1, 9] = fy * y / z + cy - measured[1]
    result[2, 9] = fx * baseline / z - measured[2]
    # In the camera frame, a translation of the camera moves the point by its negative.
    result[0, 3], result[0, 5] = -fx / z, fx * x / (z * z)
    result[1, 4], result[1, 5] = -fy / z, fy * y / (z * z)
    result[2, 5] = fx * baseline / (z * z)
    for i in range(3):
        a, b, c = -result[i, 3], -result[i, 4], -result[i, 5]
        result[i, 0] = b * z - c * y
        result[i, 1] = c * x - a * z
        result[i, 2] = a * y - b * x
        for n in range(3):
            result[i, 6 + n] = a * T[n, 0] + b * T[n, 1] + c * T[n, 2]
    return result


@kernel
def _stereo_kernel(
    T: Array,
    landmark: Array,
    measured: Array,
    camera: Array,
    error: Array,
    by_pose: Array,
    by_landmark: Array,
) -> None:
    """Write the error (3,) and its Jacobians with respect to pose (3, 6) and landmark (3, 3)."""
    result = reprojection_kernel(row_major_kernel(T), landmark, measured, camera)
    copy_columns_kernel(result, 0.0, by_pose)
    copy_columns_kernel(result, 6.0, by_landmark)
    for i in range(3):
        error[i] = result[i, 9]


def checked_measurement(measured: ArrayLike) -> Array:
    """Check that (u_left, v, disparity) is finite with positive disparity; return it as (3,)."""
    measurement = checked_vector("measured", measured, 3)
    if measurement[2] <= 0:
        raise ValueError(f"measured must have a positive disparity, not {measurement}")
    return measurement


def StereoReprojectionFactor(
    measured: ArrayLike,
    model: gtsam.noiseModel.Base,
    pose: int,
    landmark: int,
    camera: StereoCamera,
) -> gtsam.CustomFactor:
    """Stereo measurement of a landmark, equation (meas_err) with error = prediction - measurement.

    Parameters
    ----------
    measured
        (u_left, v, disparity) in rectified pixels.
    model
        Noise model of dimension 3, which may be robust.
    pose, landmark
        Keys of a Pose3 T_world_cam and of a Point3 in the world.
    camera
        Intrinsics of the rectified pair.

    Raises
    ------
    ValueError
        If the measurement is not three finite numbers, the disparity is not positive, or the noise
        model has another dimension.
    """
    checked_noise(model, 3)
    measurement, parameters = checked_measurement(measured), camera.parameters

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: gtsam.JacobianVector | None
    ) -> Array:
        difference = np.empty(3)
        with _BLOCKS.lock:
            _stereo_kernel(
                values.atPose3(pose).matrix(),
                values.atPoint3(landmark),
                measurement,
                parameters,
                difference,
                *_BLOCKS.views,
            )
            if jacobians is not None:
                _BLOCKS.copy_to(jacobians)
        return difference

    return gtsam.CustomFactor(model, [pose, landmark], error)
