"""A rectified stereo camera, and the reprojection of a landmark into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    Pose,
    checked_finite_noise,
    checked_key,
    checked_number,
    checked_numbers,
    checked_vector,
)
from factors.factor import Described
from factors.kernels.compiled import kernel
from factors.kernels.se3 import Array
from factors.mounting import checked_mounting
from factors.variables import POINT3, POSE3, Variable, checked_keys

StereoMeasurement = ArrayLike | gtsam.StereoPoint2
"""(u_left, v, disparity), or GTSAM's (u_left, u_right, v)."""
StereoMeasurements = ArrayLike | Sequence[StereoMeasurement]

_TO_GTSAM = np.array([[1.0, 0, 0], [1, 0, -1], [0, 1, 0]])
"""Turns (u_left, v, disparity) into (u_left, u_right, v)."""
_TO_OURS = np.linalg.inv(_TO_GTSAM)


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
        for name, value in vars(self).items():
            number = checked_number(name, value)
            if name not in ("cx", "cy") and number <= 0:
                raise ValueError(f"{name} must be positive, not {value}")
            object.__setattr__(self, name, number)

    @classmethod
    def from_gtsam(cls, calibration: gtsam.Cal3_S2Stereo) -> StereoCamera:
        """Make a camera of GTSAM's calibration.

        Raises
        ------
        ValueError
            If it has skew: pixels of a rectified pair have none.
        """
        K = calibration.K()
        if K[0, 1] != 0:
            raise ValueError(f"calibration must have no skew, not {K[0, 1]}: rectify the images")
        (fx, _, cx), (_, fy, cy), _ = K.tolist()
        return cls(fx, fy, cx, cy, calibration.baseline())

    def to_gtsam(self) -> gtsam.Cal3_S2Stereo:
        """Return GTSAM's calibration of the same camera."""
        return gtsam.Cal3_S2Stereo(self.fx, self.fy, 0.0, self.cx, self.cy, self.baseline)

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


Camera = StereoCamera | gtsam.Cal3_S2Stereo


def as_camera(camera: Camera) -> StereoCamera:
    """Return a camera of ours.

    Raises
    ------
    ValueError
        If it is neither a StereoCamera nor a gtsam.Cal3_S2Stereo.
    """
    if isinstance(camera, gtsam.Cal3_S2Stereo):
        return StereoCamera.from_gtsam(camera)
    if not isinstance(camera, StereoCamera):
        raise ValueError(f"camera must be a StereoCamera, not {type(camera).__name__}")
    return camera


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


def checked_measurement(measured: ArrayLike) -> Array:
    """Check that (u_left, v, disparity) is finite with positive disparity; return it as (3,)."""
    measurement = checked_vector("measured", measured, 3)
    if measurement[2] <= 0:
        raise ValueError(f"measured must have a positive disparity, not {measurement}")
    return measurement


def stereo_measurement(
    measured: StereoMeasurement, model: gtsam.noiseModel.Base
) -> tuple[Array, gtsam.noiseModel.Base]:
    """Check a measurement and its noise model; return it as (u_left, v, disparity), (3,).

    The noise of a gtsam.StereoPoint2 is that of (u_left, u_right, v), and is converted. It must not
    be Constrained: behind the camera the Jacobian is zero, and GTSAM can end the process for that.
    """
    checked_finite_noise(model, 3)
    if not isinstance(measured, gtsam.StereoPoint2):
        return checked_measurement(measured), model
    u_left, u_right, v = measured.uL(), measured.uR(), measured.v()
    return checked_measurement([u_left, v, u_left - u_right]), _mixed_noise(model, False)


def stereo_measurements(
    measured: StereoMeasurements, model: gtsam.noiseModel.Base
) -> tuple[Array, gtsam.noiseModel.Base]:
    """Return many measurements (n, 3) and their noise, as `stereo_measurement` does."""
    if isinstance(measured, Sequence) and len(measured):
        if len({isinstance(each, gtsam.StereoPoint2) for each in measured}) > 1:
            raise ValueError("measured must not mix StereoPoint2 and arrays: their noise differs")
        pairs = [stereo_measurement(each, model) for each in measured]
        return np.array([each for each, _ in pairs]), pairs[0][1]
    return checked_numbers("measured", measured), model


# Factors share their noise models, and making one takes longer than a factor.
@lru_cache(maxsize=256)
def _mixed_noise(model: gtsam.noiseModel.Base, to_gtsam: bool) -> gtsam.noiseModel.Base:
    """Return the noise of GTSAM's measurement from that of ours, or the other way round."""
    if isinstance(model, gtsam.noiseModel.Robust):
        return gtsam.noiseModel.Robust.Create(model.robust(), _mixed_noise(model.noise(), to_gtsam))
    root = model.Whiten(np.eye(3))
    information = root @ (_TO_OURS if to_gtsam else _TO_GTSAM)
    return gtsam.noiseModel.Gaussian.SqrtInformation(np.linalg.qr(information, mode="r"), False)


class StereoReprojectionFactor(Described, gtsam.GenericStereoFactor3D):
    """Stereo measurement of a landmark, equation (meas_err) with error = prediction - measurement.

    It is GTSAM's own factor of the same measurement, and just as fast; graph.at(i) is a plain
    GenericStereoFactor3D once nobody holds this object. GTSAM measures (u_left, u_right, v): the
    noise model is converted, and `unwhitenedError` is in that order.

    Parameters
    ----------
    measured
        (u_left, v, disparity) in rectified pixels; or gtsam.StereoPoint2.
    model
        Noise model of dimension 3, which may be robust: of (u_left, v, disparity), or of (u_left,
        u_right, v) if measured is a StereoPoint2.
    pose, landmark
        Keys of a Pose3 T_world_body and of a Point3 in the world.
    camera
        Intrinsics of the rectified pair; or gtsam.Cal3_S2Stereo.
    T_body_cam
        (4, 4) pose of the left camera in the body, or gtsam.Pose3; by default they are the same.

    Raises
    ------
    ValueError
        If the measurement is not three finite numbers, the disparity is not positive, the noise
        model has another dimension or is Constrained, or the keys are the same.

    Notes
    -----
    Behind the camera the error is GTSAM's large constant and the Jacobian is zero.
    """

    camera: StereoCamera

    @property
    def measured(self) -> Array:  # type: ignore[override]
        """The measurement (u_left, v, disparity), (3,)."""
        measured: Array = self._made_of["measured"]
        return measured

    def __init__(
        self,
        measured: StereoMeasurement,
        model: gtsam.noiseModel.Base,
        pose: int,
        landmark: int,
        camera: Camera,
        T_body_cam: Pose | None = None,
    ) -> None:
        measurement, noise = stereo_measurement(measured, model)
        camera = as_camera(camera)
        pose, landmark = checked_key("pose", pose), checked_key("landmark", landmark)
        checked_keys([Variable("pose", pose, POSE3), Variable("landmark", landmark, POINT3)])
        mounted = checked_mounting(T_body_cam)
        self._describe(
            {
                "measured": measurement,
                "model": noise,
                "pose": pose,
                "landmark": landmark,
                "camera": camera,
                "T_body_cam": mounted,
            }
        )
        u_left, v, disparity = measurement
        super().__init__(
            gtsam.StereoPoint2(u_left, u_left - disparity, v),
            _mixed_noise(noise, True),
            pose,
            landmark,
            camera.to_gtsam(),
            False,
            False,
            gtsam.Pose3(np.eye(4) if mounted is None else mounted),
        )
