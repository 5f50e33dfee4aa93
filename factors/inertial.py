"""Inertial sensors on a body whose states are a pose and a body twist."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    Pose,
    checked_duration,
    checked_key,
    checked_noise,
    checked_pose,
    checked_vector,
)
from factors.factor import Factor
from factors.jacobian_blocks import JacobianBlocks, Jacobians
from factors.kernels.imu import imu_kernel
from factors.kernels.se3 import Array
from factors.lie import se3_exp, se3_right_jacobian_inverse
from factors.variables import BIAS, TWIST, State, Variable, as_state, variables_of

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

        variables = [Variable("velocity", velocity, TWIST), Variable("bias", bias, BIAS)]
        made_of = {
            "measured": rate,
            "model": model,
            "velocity": velocity,
            "bias": bias,
            "T_body_imu": T,
        }
        super().__init__(model, variables, error, made_of)


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
        If the measurements do not last from state i to state j, or their parameters have another
        error than GTSAM's default, Logmap, or the rotation of the Earth; and see `Factor`.

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
        _check_duration(preintegrated, states[1][2] - states[0][2])
        native = gtsam.ImuFactor(0, 1, 2, 3, 4, preintegrated)
        constants = _constants(preintegrated)
        _check_error(native, constants)
        (pose_i, velocity_i, _), (pose_j, velocity_j, _) = states

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            own = _BLOCKS.own
            imu_kernel(
                values.atPose3(pose_i).matrix(),
                values.atVector6(velocity_i),
                values.atPose3(pose_j).matrix(),
                values.atVector6(velocity_j),
                values.atConstantBias(bias).vector(),
                constants,
                own.outputs,
            )
            if jacobians is not None:
                own.copy_to(jacobians)
            return own.error

        variables = [*variables_of(*states), Variable("bias", bias, BIAS)]
        made_of = {
            # A copy: the caller may reset his, and integrate on.
            "preintegrated": native.preintegratedMeasurements(),
            "state_i": states[0],
            "state_j": states[1],
            "bias": bias,
        }
        super().__init__(native.noiseModel(), variables, error, made_of)


def _check_duration(preintegrated: object, duration: float) -> None:
    """Check that these are measurements, and last as long as from state i to state j, seconds."""
    if not isinstance(preintegrated, gtsam.PreintegratedImuMeasurements):
        kind = type(preintegrated).__name__
        raise ValueError(f"preintegrated must be PreintegratedImuMeasurements, not {kind}")
    measured = preintegrated.deltaTij()
    if not abs(measured - duration) <= 1e-6 + 1e-9 * abs(duration):
        raise ValueError(
            f"preintegrated must last from state_i to state_j, {duration} s, not {measured} s"
        )
    checked_duration(duration, "the time from state_i to state_j")


def _constants(preintegrated: gtsam.PreintegratedImuMeasurements) -> Array:
    """Return the constants that `imu_kernel` takes.

    GTSAM tells the Jacobian of its prediction from rest, which turns with what is preintegrated.
    """
    dt, at_bias = preintegrated.deltaTij(), preintegrated.preintegrated()
    by_bias, by_state = np.zeros((9, 6), order="F"), np.zeros((9, 9), order="F")
    rest, known = gtsam.NavState(), preintegrated.biasHat()
    predicted = preintegrated.predict(rest, known, by_state, by_bias)
    turn = se3_right_jacobian_inverse(np.r_[at_bias[:3], 0, 0, 0])[:3, :3]
    R = preintegrated.deltaRij().matrix()
    by_bias = np.vstack([turn @ by_bias[:3], R @ by_bias[3:6], R @ by_bias[6:]])
    gravity = (predicted.velocity() - preintegrated.deltaVij()) / dt
    return np.r_[dt, gravity, at_bias - by_bias @ known.vector(), by_bias.ravel()]


def _check_error(native: gtsam.ImuFactor, constants: Array) -> None:
    """Check at a state that the error is GTSAM's: it does not tell which one was chosen.

    The turn is near the measured one, as GTSAM's logarithm is less exact near half a turn.
    """
    measured, own = native.preintegratedMeasurements(), _BLOCKS.own
    T_i, turned = gtsam.Pose3(), gtsam.Pose3(measured.deltaRij(), np.zeros(3))
    T_j = turned.compose(gtsam.Pose3(se3_exp(np.arange(1, 7) / 10)))
    twist, bias = np.arange(6) / 10, measured.biasHat()
    ends = T_i.matrix(), twist, T_j.matrix(), twist
    imu_kernel(*ends, bias.vector(), constants, own.outputs)
    in_world = twist[3:], T_j.rotation().rotate(twist[3:])
    expected = native.evaluateError(T_i, in_world[0], T_j, in_world[1], bias)
    # After seconds of fast turns the constants are large, and cancel in the error.
    rounding = 1e-12 * max(1.0, np.abs(expected).max(), np.abs(constants).max())
    if not np.abs(own.error - expected).max() <= rounding:
        raise ValueError(
            "preintegrated must have gtsam.ImuFactorErrorMode.Logmap and no setOmegaCoriolis"
        )
