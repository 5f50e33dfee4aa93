"""A stereo measurement at its own time, between two states of a WNOA trajectory."""

from __future__ import annotations

import gtsam
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from factors.interpolation import interpolate_kernel, interpolation_jacobian_kernel
from factors.stereo import StereoCamera, checked_measurement, reprojection_kernel

Array = NDArray[np.float64]


@njit(cache=True)
def _linearized(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    a: float,
    b: float,
    landmark: Array,
    measured: Array,
    camera: Array,
) -> tuple[Array, Array, Array]:
    """Error (3,) and its derivatives by the states (3, 24) and by the landmark (3, 3)."""
    T, _ = interpolate_kernel(T_i, v_i, T_j, v_j, a, b)
    by_states, _ = interpolation_jacobian_kernel(T_i, v_i, T_j, v_j, a, b)
    error, by_pose, by_landmark = reprojection_kernel(T, landmark, measured, camera)
    return error, by_pose @ by_states[:6], by_landmark


def InterpolatedStereoFactor(
    measured: ArrayLike,
    model: gtsam.noiseModel.Base,
    pose_i: int,
    velocity_i: int,
    pose_j: int,
    velocity_j: int,
    landmark: int,
    camera: StereoCamera,
    t_i: float,
    t_j: float,
    t: float,
) -> gtsam.CustomFactor:
    """Stereo measurement of a landmark at a time t between two states.

    Parameters
    ----------
    measured
        (u_left, v, disparity) in rectified pixels.
    model
        Noise model of dimension 3; robust ones are welcome.
    pose_i, velocity_i, pose_j, velocity_j
        Keys of the states at t_i and t_j: Pose3 T_world_cam and body twists (6,), rotation first.
    landmark
        Key of a Point3 in the world.
    camera
        Intrinsics of the rectified pair.
    t_i, t_j, t
        Seconds, t_i <= t <= t_j and t_i < t_j.

    Raises
    ------
    ValueError
        If the times are out of order or the measurement is not three finite numbers.
    """
    if not (t_i < t_j and t_i <= t <= t_j):
        raise ValueError(f"t = {t} must lie between t_i = {t_i} and t_j = {t_j}")
    a, b = float(t - t_i), float(t_j - t)
    measurement, parameters = checked_measurement(measured), camera.parameters

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        T_i, T_j = values.atPose3(pose_i).matrix(), values.atPose3(pose_j).matrix()
        v_i, v_j = values.atVector(velocity_i), values.atVector(velocity_j)
        point = values.atPoint3(landmark)
        if jacobians is None:
            T, _ = interpolate_kernel(T_i, v_i, T_j, v_j, a, b)
            return reprojection_kernel(T, point, measurement, parameters)[0]
        residual, by_states, jacobians[4] = _linearized(
            T_i, v_i, T_j, v_j, a, b, point, measurement, parameters
        )
        for block in range(4):
            jacobians[block] = by_states[:, 6 * block : 6 * block + 6]
        return residual

    keys = [pose_i, velocity_i, pose_j, velocity_j, landmark]
    return gtsam.CustomFactor(model, keys, error)
