"""Inertial sensors on a body whose states are a pose and a body twist."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Pose, checked_key, checked_noise, checked_pose, checked_vector
from factors.factor import Factor
from factors.jacobian_blocks import JacobianBlocks, Jacobians
from factors.kernels.outputs import Addresses, jacobian_at
from factors.kernels.se3 import Array, kernel
from factors.variables import BIAS, POSE3, TWIST, State, Variable, as_state

_BLOCKS = JacobianBlocks(9, (6, 6, 6, 6, 6))


class GyroFactor(Factor):
    """Angular rate measured by a gyroscope: error R_imu_body omega + gyroscope bias - measured.

    At its own time between two states it is held by an InterpolatedFactor:

    >>> gyro = GyroFactor(measured, noise, velocity=0, bias=B(0))  # 0 stands for the twist at t
    >>> graph.add(InterpolatedFactor(gyro, state_i, state_j, t, velocity=0))

    Parameters
    ----------
    measured
        (3,) rad/s in the gyroscope's frame.
    model
        Noise model of dimension 3, rad/s.
    velocity
        Key of the body twist (6,), rotation first.
    bias
        Key of a gtsam.imuBias.ConstantBias.
    T_body_imu
        (4, 4) pose of the sensor in the body, or gtsam.Pose3; by default they are the same.

    Raises
    ------
    ValueError
        If the measurement is not three finite numbers or the noise has another dimension; and see
        `Factor`.
    """

    measured: Array

    def __init__(
        self,
        measured: ArrayLike,
        model: gtsam.noiseModel.Base,
        velocity: int,
        bias: int,
        T_body_imu: Pose | None = None,
    ) -> None:
        checked_noise(model, 3)
        rate = checked_vector("measured", measured, 3)
        velocity, bias = checked_key("velocity", velocity), checked_key("bias", bias)
        T = None if T_body_imu is None else checked_pose("T_body_imu", T_body_imu)
        R_imu_body = np.eye(3) if T is None else T[:3, :3].T
        by_velocity = np.hstack([R_imu_body, np.zeros((3, 3))])
        by_bias = np.hstack([np.zeros((3, 3)), np.eye(3)])  # accelerometer, then gyroscope
        constant = gtsam.JacobianVector([by_velocity, by_bias])

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            if jacobians is not None:
                jacobians.clear()
                jacobians.extend(constant)
            turned: Array = by_velocity @ values.atVector6(velocity)
            return turned + values.atConstantBias(bias).gyroscope() - rate

        variables = [
            Variable("velocity", velocity, TWIST),
            Variable("bias", bias, BIAS),
        ]
        made_of = {"measured": rate, "model": model, "velocity": velocity, "bias": bias}
        super().__init__(model, variables, error, {**made_of, "T_body_imu": T})


class ImuFactor(Factor):
    """Preintegrated accelerations and rates between two states: gtsam.ImuFactor of body twists.

    GTSAM's velocity is that of the body in the world, R_world_body v with v the linear part of the
    twist. The angular part is measured by a `GyroFactor`.

    Parameters
    ----------
    preintegrated
        gtsam.PreintegratedImuMeasurements from i to j. Its parameters hold gravity, noise and, as
        body_P_sensor, the pose of the sensor in the body.
    state_i, state_j
        gtsam.StateData, or tuples (pose key, velocity key, seconds): Pose3 T_world_body in a world
        with the gravity of the parameters, and body twists (6,), rotation first.
    bias
        Key of a gtsam.imuBias.ConstantBias.

    Raises
    ------
    ValueError
        If the measurements do not last from state i to state j; and see `Factor`.

    Notes
    -----
    Error and noise are those of gtsam.ImuFactor: rotation, position, velocity, (9,).
    """

    def __init__(
        self,
        preintegrated: gtsam.PreintegratedImuMeasurements,
        state_i: State,
        state_j: State,
        bias: int,
    ) -> None:
        states = as_state("state_i", state_i), as_state("state_j", state_j)
        bias = checked_key("bias", bias)
        if not isinstance(preintegrated, gtsam.PreintegratedImuMeasurements):
            kind = type(preintegrated).__name__
            raise ValueError(f"preintegrated must be PreintegratedImuMeasurements, not {kind}")
        duration = states[1][2] - states[0][2]
        if not abs(preintegrated.deltaTij() - duration) <= 1e-6 + 1e-9 * abs(duration):
            raise ValueError(
                f"preintegrated must last from state_i to state_j, {duration} s, not "
                f"{preintegrated.deltaTij()} s"
            )
        native = gtsam.ImuFactor(0, 1, 2, 3, 4, preintegrated)
        (pose_i, velocity_i, _), (pose_j, velocity_j, _) = states

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            T_i, T_j = values.atPose3(pose_i), values.atPose3(pose_j)
            twists = values.atVector6(velocity_i), values.atVector6(velocity_j)
            ends, in_world = (T_i.matrix(), T_j.matrix(), *twists), np.empty((2, 3))
            _in_world_kernel(*ends, in_world)
            at = T_i, in_world[0], T_j, in_world[1], values.atConstantBias(bias)
            if jacobians is None:
                return native.evaluateError(*at)
            own, by_v = _BLOCKS.own, np.empty((9, 6), order="F")
            by_T_i, _, by_T_j, _, by_bias = own.views
            found = native.evaluateError(*at, by_T_i, by_v[:, :3], by_T_j, by_v[:, 3:], by_bias)
            _by_twists_kernel(*ends, by_v, own.outputs)
            own.copy_to(jacobians)
            return found

        variables = [
            Variable("pose_i", pose_i, POSE3),
            Variable("velocity_i", velocity_i, TWIST),
            Variable("pose_j", pose_j, POSE3),
            Variable("velocity_j", velocity_j, TWIST),
            Variable("bias", bias, BIAS),
        ]
        made_of = {"preintegrated": preintegrated, "state_i": states[0], "state_j": states[1]}
        super().__init__(native.noiseModel(), variables, error, {**made_of, "bias": bias})


@kernel
def _in_world_kernel(T_i: Array, T_j: Array, v_i: Array, v_j: Array, in_world: Array) -> None:
    """Write the velocities (2, 3) in the world, R v."""
    for k in range(3):
        in_world[0, k] = T_i[k, 0] * v_i[3] + T_i[k, 1] * v_i[4] + T_i[k, 2] * v_i[5]
        in_world[1, k] = T_j[k, 0] * v_j[3] + T_j[k, 1] * v_j[4] + T_j[k, 2] * v_j[5]


@kernel
def _by_twists_kernel(
    T_i: Array, T_j: Array, v_i: Array, v_j: Array, by_v: Array, outputs: Addresses
) -> None:
    """Turn Jacobians by the velocities in the world, (9, 3) each, into those by twists.

    The velocity R v turns with the pose, by -R [v]x, and moves with the twist, by R.
    """
    for T, v, end in ((T_i, v_i, 0), (T_j, v_j, 1)):
        by_pose = jacobian_at(outputs, 2 * end, 9, 6)
        by_twist = jacobian_at(outputs, 2 * end + 1, 9, 6)
        for r in range(9):
            for k in range(3):
                by_twist[r, k], by_twist[r, 3 + k] = 0.0, 0.0
                for m in range(3):
                    by_twist[r, 3 + k] += by_v[r, 3 * end + m] * T[m, k]
            x, y, z = by_twist[r, 3], by_twist[r, 4], by_twist[r, 5]
            by_pose[r, 0] += v[4] * z - v[5] * y
            by_pose[r, 1] += v[5] * x - v[3] * z
            by_pose[r, 2] += v[3] * y - v[4] * x
