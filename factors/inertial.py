"""Inertial sensors on a body whose states are a pose and a body twist."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Pose, checked_noise, checked_pose, checked_vector
from factors.factor import Factor
from factors.inner_factor import parts_of
from factors.jacobian_blocks import Jacobians, fill
from factors.kernels import Array
from factors.variables import BIAS, POSE3, TWIST, State, Variable, as_state


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
        T = None if T_body_imu is None else checked_pose("T_body_imu", T_body_imu)
        R_imu_body = np.eye(3) if T is None else T[:3, :3].T
        by_velocity = np.hstack([R_imu_body, np.zeros((3, 3))])
        by_bias = np.hstack([np.zeros((3, 3)), np.eye(3)])  # accelerometer, then gyroscope

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            if jacobians is not None:
                fill(jacobians, [by_velocity, by_bias])
            turned: Array = by_velocity @ values.atVector6(velocity)
            return turned + values.atConstantBias(bias).gyroscope() - rate

        variables = [
            Variable("velocity", int(velocity), TWIST),
            Variable("bias", int(bias), BIAS),
        ]
        made_of = {"measured": rate, "model": model, "velocity": int(velocity), "bias": int(bias)}
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
        duration = states[1][2] - states[0][2]
        if not abs(preintegrated.deltaTij() - duration) <= 1e-6 + 1e-9 * abs(duration):
            raise ValueError(
                f"preintegrated must last from state_i to state_j, {duration} s, not "
                f"{preintegrated.deltaTij()} s"
            )
        native = gtsam.ImuFactor(0, 1, 2, 3, 4, preintegrated)
        model, _, evaluate = parts_of(native)
        (pose_i, velocity_i, _), (pose_j, velocity_j, _) = states

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            at, turns = gtsam.Values(), []
            for key, pose, velocity in ((0, pose_i, velocity_i), (2, pose_j, velocity_j)):
                T, v = values.atPose3(pose), values.atVector6(velocity)[3:]
                R = T.rotation().matrix()
                at.insert(key, pose3=T)  # by name: see CopiedValue
                at.insertPoint3(key + 1, R @ v)
                turns.append((R, v))
            at.insert(4, constant_bias=values.atConstantBias(bias))
            if jacobians is None:
                return evaluate(at, None)
            inner: list[Any] = [None] * 5
            found, blocks = evaluate(at, inner), list[Array]()
            for n, (R, v) in enumerate(turns):
                blocks += _by_state(inner[2 * n], inner[2 * n + 1] @ R, v)
            fill(jacobians, [*blocks, inner[4]])
            return found

        variables = [
            Variable("pose_i", pose_i, POSE3),
            Variable("velocity_i", velocity_i, TWIST),
            Variable("pose_j", pose_j, POSE3),
            Variable("velocity_j", velocity_j, TWIST),
            Variable("bias", int(bias), BIAS),
        ]
        made_of = {"preintegrated": preintegrated, "state_i": states[0], "state_j": states[1]}
        super().__init__(model, variables, error, {**made_of, "bias": int(bias)})


def _by_state(by_pose: Array, by_velocity: Array, v: Array) -> tuple[Array, Array]:
    """Return the Jacobians (9, 6) by pose and twist, from that by the pose at fixed velocity R v.

    `by_velocity` (9, 3) is that by the velocity v in the body; R v turns with the pose.
    """
    x, y, z = v
    turned = by_pose.copy()
    turned[:, :3] -= by_velocity @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    by_twist = np.zeros((len(by_pose), 6))
    by_twist[:, 3:] = by_velocity
    return turned, by_twist
