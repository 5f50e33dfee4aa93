"""A rectified stereo camera, and the reprojection of a landmark into it."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


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

    @property
    def parameters(self) -> Array:
        """(5,) fx, fy, cx, cy, baseline."""
        return np.array([self.fx, self.fy, self.cx, self.cy, self.baseline])

    def project(self, points: ArrayLike) -> Array:
        """Measurements (..., 3) of points (..., 3) in the left camera frame, Z > 0."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        u, v = self.fx * x / z + self.cx, self.fy * y / z + self.cy
        return np.stack([u, v, self.fx * self.baseline / z], axis=-1)

    def project_with_jacobian(self, points: ArrayLike) -> tuple[Array, Array]:
        """Measurements (..., 3) of points (..., 3) and their derivatives (..., 3, 3)."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        jacobian = np.zeros((*np.shape(x), 3, 3))
        jacobian[..., 0, 0] = self.fx / z
        jacobian[..., 0, 2] = -self.fx * x / z**2
        jacobian[..., 1, 1] = self.fy / z
        jacobian[..., 1, 2] = -self.fy * y / z**2
        jacobian[..., 2, 2] = -self.fx * self.baseline / z**2
        return self.project(points), jacobian

    def triangulate(self, measurements: ArrayLike) -> Array:
        """Points (..., 3) in the left camera frame of measurements (..., 3), disparity > 0."""
        u, v, disparity = np.moveaxis(np.asarray(measurements, np.float64), -1, 0)
        z = self.fx * self.baseline / disparity
        return np.stack([(u - self.cx) * z / self.fx, (v - self.cy) * z / self.fy, z], axis=-1)


@njit(cache=True)
def reprojection_kernel(
    T: Array, landmark: Array, measured: Array, camera: Array
) -> tuple[Array, Array, Array]:
    """Error (3,) and its derivatives by the pose (3, 6) and the landmark (3, 3).

    Behind the camera: a large constant error without derivatives, as GTSAM's own stereo factor.
    """
    by_pose, by_landmark = np.zeros((3, 6)), np.zeros((3, 3))
    p = np.empty(3)
    for i in range(3):
        p[i] = 0.0
        for j in range(3):
            p[i] += T[j, i] * (landmark[j] - T[j, 3])
    x, y, z = p
    fx, fy, cx, cy, baseline = camera
    if z <= 0:
        return np.full(3, 2 * fx), by_pose, by_landmark
    error = np.array([fx * x / z + cx, fy * y / z + cy, fx * baseline / z]) - measured
    by_point = np.zeros((3, 3))
    by_point[0, 0], by_point[0, 2] = fx / z, -fx * x / z**2
    by_point[1, 1], by_point[1, 2] = fy / z, -fy * y / z**2
    by_point[2, 2] = -fx * baseline / z**2
    for i in range(3):
        a, b, c = by_point[i]
        by_pose[i, 0], by_pose[i, 1], by_pose[i, 2] = b * z - c * y, c * x - a * z, a * y - b * x
        by_pose[i, 3], by_pose[i, 4], by_pose[i, 5] = -a, -b, -c
        for j in range(3):
            by_landmark[i, j] = a * T[j, 0] + b * T[j, 1] + c * T[j, 2]
    return error, by_pose, by_landmark


def checked_measurement(measured: ArrayLike) -> Array:
    """(3,) finite numbers (u_left, v, disparity); ValueError otherwise."""
    measurement = np.asarray(measured, np.float64)
    if measurement.shape != (3,) or not np.isfinite(measurement).all():
        raise ValueError(f"measured must be finite (u_left, v, disparity), not {measured}")
    return measurement


def StereoReprojectionFactor(
    measured: ArrayLike,
    model: gtsam.noiseModel.Base,
    pose: int,
    landmark: int,
    camera: StereoCamera,
) -> gtsam.CustomFactor:
    """Stereo measurement of a landmark, equation (meas_err) with the sign of prediction - measured.

    Parameters
    ----------
    measured
        (u_left, v, disparity) in rectified pixels.
    model
        Noise model of dimension 3; robust ones are welcome.
    pose, landmark
        Keys of a Pose3 T_world_cam and of a Point3 in the world.
    camera
        Intrinsics of the rectified pair.

    Raises
    ------
    ValueError
        If the measurement is not three finite numbers.
    """
    measurement, parameters = checked_measurement(measured), camera.parameters

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        residual, by_pose, by_landmark = reprojection_kernel(
            values.atPose3(pose).matrix(), values.atPoint3(landmark), measurement, parameters
        )
        if jacobians is not None:
            jacobians[0], jacobians[1] = by_pose, by_landmark
        return residual

    return gtsam.CustomFactor(model, [pose, landmark], error)
