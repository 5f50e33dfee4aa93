"""Factor of a stereo measurement at its own time, between two states of a WNOA trajectory."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_noise, power_spectral_density
from factors.jacobian_blocks import JacobianBlocks
from factors.kernels import (
    EXACT,
    Array,
    copy_columns_kernel,
    hermite_weights,
    interpolated_local_kernel,
    kernel,
    local_jacobian_kernel,
    local_state_kernel,
    retract_kernel,
    row_major_kernel,
    rows_by_states_kernel,
)
from factors.stereo import StereoCamera, checked_measurement, reprojection_kernel

_BLOCKS = JacobianBlocks(3, (6, 6, 6, 6, 3))


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
    error: Array,
    by_T_i: Array,
    by_v_i: Array,
    by_T_j: Array,
    by_v_j: Array,
    by_landmark: Array,
) -> None:
    """Write the error (3,) and its Jacobians with respect to states (3, 6) and landmark (3, 3)."""
    T_i = row_major_kernel(T_i)
    weights = hermite_weights(a, b)
    local_j = local_state_kernel(T_i, row_major_kernel(T_j), v_j)
    local = interpolated_local_kernel(v_i, local_j, weights)
    T, v = np.empty((4, 4)), np.empty(6)
    retract_kernel(T_i, local, T, v)
    stereo = reprojection_kernel(T, landmark, measured, camera)
    for i in range(3):
        error[i] = stereo[i, 9]
    if derivatives:
        by_states_j = local_jacobian_kernel(local_j, v_j, EXACT)
        first = len(stereo) - 3
        rows = rows_by_states_kernel(stereo, first, local, by_states_j, weights)
        copy_columns_kernel(rows, 0.0, by_T_i)
        copy_columns_kernel(rows, 6.0, by_v_i)
        copy_columns_kernel(rows, 12.0, by_T_j)
        copy_columns_kernel(rows, 18.0, by_v_j)
        copy_columns_kernel(stereo, 6.0, by_landmark)


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
        Noise model of dimension 3, which may be robust.
    pose_i, velocity_i, pose_j, velocity_j
        Keys of the states at t_i and t_j: Pose3 T_world_cam and body twists (6,), rotation first.
    landmark
        Key of a Point3 in the world.
    camera
        Intrinsics of the rectified pair.
    t_i, t_j, t
        Seconds, t_i <= t <= t_j and t_i < t_j.
    qc
        Power spectral density, which is only checked. The mean between two states does not depend
        on it, because it cancels in the product of Q(t) and the inverse of Q(t_j).

    Raises
    ------
    ValueError
        If the times are out of order, the measurement is not three finite numbers, the disparity is
        not positive, or the noise model has another dimension.
    """
    if not (t_i < t_j and t_i <= t <= t_j):
        raise ValueError(f"t = {t} must lie between t_i = {t_i} and t_j = {t_j}")
    if qc is not None:
        power_spectral_density(qc)
    checked_noise(model, 3)
    a, b = float(t - t_i), float(t_j - t)
    measurement, parameters = checked_measurement(measured), camera.parameters

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: gtsam.JacobianVector | None
    ) -> Array:
        difference = np.empty(3)
        with _BLOCKS.lock:
            _linearized_kernel(
                values.atPose3(pose_i).matrix(),
                values.atVector(velocity_i),
                values.atPose3(pose_j).matrix(),
                values.atVector(velocity_j),
                a,
                b,
                values.atPoint3(landmark),
                measurement,
                parameters,
                jacobians is not None,
                difference,
                *_BLOCKS.views,
            )
            if jacobians is not None:
                _BLOCKS.copy_to(jacobians)
        return difference

    keys = [pose_i, velocity_i, pose_j, velocity_j, landmark]
    return gtsam.CustomFactor(model, keys, error)
