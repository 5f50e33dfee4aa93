"""Inertial sensors on a body whose states are a pose and a body twist."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Pose, checked_key, checked_noise, checked_pose, checked_vector
from factors.factor import Factor
from factors.inner_factor import inner_of
from factors.jacobian_blocks import JacobianBlocks, Jacobians
from factors.kernels.outputs import Addresses, error_at, jacobian_at
from factors.kernels.se3 import Array, kernel, log_kernel
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
        inner = inner_of(gtsam.ImuFactor(0, 1, 2, 3, 4, preintegrated))
        (pose_i, velocity_i, _), (pose_j, velocity_j, _) = states
        identity = gtsam.Values()
        for key in (0, 2):
            identity.insert(key, gtsam.Pose3())
            identity.insertPoint3(key + 1, np.zeros(3))
        identity.insert(4, gtsam.imuBias.ConstantBias())

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            T_i, v_i = values.atPose3(pose_i).matrix(), values.atVector6(velocity_i)
            T_j, v_j = values.atPose3(pose_j).matrix(), values.atVector6(velocity_j)
            step, steps = gtsam.VectorValues(), np.empty((4, 6))
            _in_world_kernel(T_i, v_i, T_j, v_j, steps)
            for key in (0, 2):
                step.insert(key, steps[key])
                step.insert(key + 1, steps[key + 1, :3])
            step.insert(4, values.atConstantBias(bias).vector())
            at = identity.retract(step)  # much faster than inserting each
            if jacobians is None:
                return inner.error(at)
            own = _BLOCKS.own
            _by_twists_kernel(inner.system(at), T_i, v_i, T_j, v_j, own.outputs)
            own.copy_to(jacobians)
            return own.error

        variables = [
            Variable("pose_i", pose_i, POSE3),
            Variable("velocity_i", velocity_i, TWIST),
            Variable("pose_j", pose_j, POSE3),
            Variable("velocity_j", velocity_j, TWIST),
            Variable("bias", bias, BIAS),
        ]
        made_of = {"preintegrated": preintegrated, "state_i": states[0], "state_j": states[1]}
        super().__init__(inner.model, variables, error, {**made_of, "bias": bias})


@kernel
def _in_world_kernel(T_i: Array, v_i: Array, T_j: Array, v_j: Array, steps: Array) -> None:
    """Write the logarithms (6,) of both poses, each before the velocity in the world, (3,)."""
    for T, v, row in ((T_i, v_i, 0), (T_j, v_j, 2)):
        xi = log_kernel(T)
        for k in range(6):
            steps[row, k] = xi[k]
        for k in range(3):
            steps[row + 1, k] = T[k, 0] * v[3] + T[k, 1] * v[4] + T[k, 2] * v[5]


@kernel
def _by_twists_kernel(
    system: Array, T_i: Array, v_i: Array, T_j: Array, v_j: Array, outputs: Addresses
) -> None:
    """Write the error (9,) of the system [J, -e] (9, 25) of gtsam.ImuFactor, and its Jacobians.

    The velocity R v turns with the pose, by -R [v]x, and moves with the twist, by R.
    """
    error, by_bias = error_at(outputs, 9), jacobian_at(outputs, 4, 9, 6)
    for r in range(9):
        error[r] = -system[r, 24]
        for k in range(6):
            by_bias[r, k] = system[r, 18 + k]
    for T, v, end in ((T_i, v_i, 0), (T_j, v_j, 1)):
        first = 9 * end
        by_pose = jacobian_at(outputs, 2 * end, 9, 6)
        by_twist = jacobian_at(outputs, 2 * end + 1, 9, 6)
        for r in range(9):
            for k in range(6):
                by_pose[r, k] = system[r, first + k]
            for k in range(3):
                by_twist[r, k], by_twist[r, 3 + k] = 0.0, 0.0
                for m in range(3):
                    by_twist[r, 3 + k] += system[r, first + 6 + m] * T[m, k]
            x, y, z = by_twist[r, 3], by_twist[r, 4], by_twist[r, 5]
            by_pose[r, 0] += v[4] * z - v[5] * y
            by_pose[r, 1] += v[5] * x - v[3] * z
            by_pose[r, 2] += v[3] * y - v[4] * x
