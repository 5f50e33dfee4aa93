"""Factor of a stereo measurement at its own time, between two states of a WNOA trajectory."""

from __future__ import annotations

from typing import Any, overload

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Pose, checked_key, power_spectral_density
from factors.factor import Factor
from factors.jacobian_blocks import JacobianBlocks
from factors.kernels.between import between_kernel, chain_kernel
from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_columns_kernel
from factors.kernels.outputs import Addresses, error_at, jacobian_at
from factors.kernels.se3 import Array
from factors.mounting import camera_by_body, checked_mounting
from factors.stereo import (
    Camera,
    StereoCamera,
    StereoMeasurement,
    as_camera,
    reprojection_kernel,
    stereo_measurement,
)
from factors.variables import (
    POINT3,
    State,
    Variable,
    are_states,
    as_state,
    checked_time_between,
    named_arguments,
    variables_of,
)

_BLOCKS = JacobianBlocks(3, (6, 6, 6, 6, 3))


@kernel
def _linearized_kernel(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    landmark: Array,
    constants: Array,
    T_body_cam: Array,
    by_body: Array,
    derivatives: bool,
    outputs: Addresses,
) -> None:
    """Write the error (3,) and its Jacobians with respect to states (3, 6) and landmark (3, 3).

    The constants (10,) are the seconds after state i and before state j, the measurement and the
    intrinsics; `by_body` (6, 6) is the Jacobian of the camera's pose with respect to the body's.
    """
    found, t, T_world_cam = np.empty(48), constants[:2], np.zeros((4, 4))
    between_kernel(T_i, v_i, T_j, v_j, t, found)
    for i in range(3):
        for k in range(4):
            for j in range(4):
                T_world_cam[i, j] += found[6 + 4 * i + k] * T_body_cam[k, j]
    stereo = reprojection_kernel(T_world_cam, landmark, constants[2:5], constants[5:10])
    error, by_pose = error_at(outputs, 3), np.zeros((6, 3))
    for i in range(3):
        error[i] = stereo[i, 9]
        for k in range(6):
            for j in range(6):
                by_pose[j, i] += stereo[i, k] * by_body[k, j]
    if derivatives:
        chain_kernel(v_j, t, found, by_pose, by_pose[:0], outputs)
        copy_columns_kernel(stereo, 6, jacobian_at(outputs, 4, 3, 3))


class InterpolatedStereoFactor(Factor):
    """Stereo measurement of a landmark at a time t between two states.

    It takes either the states, `InterpolatedStereoFactor(measured, model, state_i, state_j,
    landmark, camera, t)`, or their keys and times, `InterpolatedStereoFactor(measured, model,
    pose_i, velocity_i, pose_j, velocity_j, landmark, camera, t_i, t_j, t)`.

    Parameters
    ----------
    measured
        (u_left, v, disparity) in rectified pixels; or gtsam.StereoPoint2.
    model
        Noise model of dimension 3, which may be robust: of (u_left, v, disparity), or of (u_left,
        u_right, v) if measured is a StereoPoint2.
    state_i, state_j
        gtsam.StateData, or tuples (pose key, velocity key, seconds): Pose3 T_world_body and body
        twists (6,), rotation first.
    landmark
        Key of a Point3 in the world.
    camera
        Intrinsics of the rectified pair; or gtsam.Cal3_S2Stereo.
    t
        Seconds, t_i <= t <= t_j and t_i < t_j.
    qc
        Power spectral density, which is only checked. The mean between two states does not depend
        on it, because it cancels in the product of Q(t) and the inverse of Q(t_j).
    T_body_cam
        (4, 4) pose of the left camera in the body, or gtsam.Pose3; by default they are the same.

    Raises
    ------
    ValueError
        If the times are out of order, the measurement is not three finite numbers, the disparity is
        not positive, or the noise model has another dimension or is Constrained; and see `Factor`.
    """

    measured: Array
    camera: StereoCamera
    t: float

    @overload
    def __init__(
        self,
        measured: StereoMeasurement,
        model: gtsam.noiseModel.Base,
        state_i: State,
        state_j: State,
        landmark: int,
        camera: Camera,
        t: float,
        qc: ArrayLike | None = None,
        T_body_cam: Pose | None = None,
    ) -> None: ...

    @overload
    def __init__(
        self,
        measured: StereoMeasurement,
        model: gtsam.noiseModel.Base,
        pose_i: int,
        velocity_i: int,
        pose_j: int,
        velocity_j: int,
        landmark: int,
        camera: Camera,
        t_i: float,
        t_j: float,
        t: float,
        qc: ArrayLike | None = None,
        T_body_cam: Pose | None = None,
    ) -> None: ...

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        made_of = _checked(**_by_states(args, kwargs))
        (pose_i, velocity_i, t_i), (pose_j, velocity_j, t_j) = (
            made_of["state_i"],
            made_of["state_j"],
        )
        landmark, t, T = made_of["landmark"], made_of["t"], made_of["T_body_cam"]
        T_body_cam = np.eye(4) if T is None else T
        by_body, intrinsics = camera_by_body(T), made_of["camera"].parameters
        constants = np.concatenate([[t - t_i, t_j - t], made_of["measured"], intrinsics])

        def error(values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
            own = _BLOCKS.own
            _linearized_kernel(
                values.atPose3(pose_i).matrix(),
                values.atVector6(velocity_i),
                values.atPose3(pose_j).matrix(),
                values.atVector6(velocity_j),
                values.atPoint3(landmark),
                constants,
                T_body_cam,
                by_body,
                jacobians is not None,
                own.outputs,
            )
            if jacobians is not None:
                own.copy_to(jacobians)
            return own.error

        variables = variables_of(made_of["state_i"], made_of["state_j"])
        variables.append(Variable("landmark", landmark, POINT3))
        super().__init__(made_of["model"], variables, error, made_of)


def _by_states(args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Name the arguments, with states instead of keys and times."""
    before, after = ("measured", "model"), ("landmark", "camera")
    options = {"qc": None, "T_body_cam": None}
    if are_states(args, kwargs, place=2):
        names = (*before, "state_i", "state_j", *after, "t")
        return named_arguments(names, options, args, kwargs)
    keys = [f"{role}_{end}" for end in "ij" for role in ("pose", "velocity")]
    given = named_arguments((*before, *keys, *after, "t_i", "t_j", "t"), options, args, kwargs)
    for end in "ij":
        parts = (given.pop(f"{part}_{end}") for part in ("pose", "velocity", "t"))
        given[f"state_{end}"] = tuple(parts)
    return given


def _checked(
    measured: StereoMeasurement,
    model: gtsam.noiseModel.Base,
    state_i: State,
    state_j: State,
    landmark: int,
    camera: Camera,
    t: float,
    qc: ArrayLike | None,
    T_body_cam: Pose | None,
) -> dict[str, Any]:
    """Check the arguments of a factor between states."""
    if qc is not None:
        power_spectral_density(qc)
    measurement, noise = stereo_measurement(measured, model)
    states = as_state("state_i", state_i), as_state("state_j", state_j)
    return {
        "measured": measurement,
        "model": noise,
        "state_i": states[0],
        "state_j": states[1],
        "landmark": checked_key("landmark", landmark),
        "camera": as_camera(camera),
        "t": checked_time_between(t, *states),
        "T_body_cam": checked_mounting(T_body_cam),
    }
