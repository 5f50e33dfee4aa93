"""A stereo measurement at its own time, between two states of a WNOA trajectory."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_noise, power_spectral_density
from factors.kernels import Array, copy_kernel, kernel
from factors.local import (
    EXACT,
    hermite_weights,
    interpolated_local_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    moved_kernel,
    rows_by_states_kernel,
)
from factors.stereo import StereoCamera, checked_measurement, reprojection_kernel
from factors.values import STATE_COLUMNS, pose_matrix


@kernel
def _linearized_kernel(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    a: float,
    b: float,
    landmark: Array,
    measured: Array,
    camera: Array,
    derivatives: bool,
) -> Array:
    """(3, 28) derivative of the error by the states (24) and the landmark (3), then the error."""
    weights = hermite_weights(a, b)
    local_j = local_state_kernel(T_i, T_j, v_j)
    local = interpolated_local_kernel(v_i, local_j, weights)
    T, v = np.empty((4, 4)), np.empty(6)
    moved_kernel(T_i, local, T, v)
    stereo = reprojection_kernel(T, landmark, measured, camera)
    result = np.zeros((3, 28))
    if derivatives:
        by_states_j = local_jacobian_kernel(local_j, v_j, EXACT)
        first = len(stereo) - 3
        copy_kernel(rows_by_states_kernel(stereo, first, local, by_states_j, weights), result)
    for i in range(3):
        for j in range(4):
            result[i, 24 + j] = stereo[i, 6 + j]
    return result


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
    qc: ArrayLike | None = None,
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
    qc
        Power spectral density, only checked: the mean between two states does not depend on it, as
        it scales Q(t) and the inverse of Q(t_j) alike.

    Raises
    ------
    ValueError
        If the times are out of order, the measurement is not three finite numbers, the disparity
        not positive, or the noise model of another dimension.
    """
    if not (t_i < t_j and t_i <= t <= t_j):
        raise ValueError(f"t = {t} must lie between t_i = {t_i} and t_j = {t_j}")
    if qc is not None:
        power_spectral_density(qc)
    checked_noise(model, 3)
    a, b = float(t - t_i), float(t_j - t)
    measurement, parameters = checked_measurement(measured), camera.parameters

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        result = _linearized_kernel(
            pose_matrix(values, pose_i),
            values.atVector(velocity_i),
            pose_matrix(values, pose_j),
            values.atVector(velocity_j),
            a,
            b,
            values.atPoint3(landmark),
            measurement,
            parameters,
            jacobians is not None,
        )
        if jacobians is not None:
            for block, columns in enumerate(STATE_COLUMNS):
                jacobians[block] = result[columns]
            jacobians[4] = result[:, 24:27]
        return result[:, 27]

    keys = [pose_i, velocity_i, pose_j, velocity_j, landmark]
    return gtsam.CustomFactor(model, keys, error)
