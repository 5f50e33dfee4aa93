"""Factors of points that a sensor on the body measures, of a lidar or a depth camera."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    Pose,
    checked_key,
    checked_noise,
    checked_number,
    checked_pose,
    checked_vector,
)
from factors.factor import Evaluate, Factor
from factors.jacobian_blocks import Jacobians, blocks_of
from factors.kernels.outputs import Addresses, error_at, jacobian_at
from factors.kernels.se3 import Array, kernel
from factors.variables import POINT3, POSE3, Variable


def _in_body(measured: ArrayLike, T_body_sensor: Pose | None) -> tuple[Array, Array, Array | None]:
    """Check a measured point; return it, it in the body's frame, and the sensor's pose there."""
    point = checked_vector("measured", measured, 3)
    if T_body_sensor is None:
        return point, point, None
    T = checked_pose("T_body_sensor", T_body_sensor)
    return point, T[:3, :3] @ point + T[:3, 3], T


@kernel
def _rows_kernel(T: Array, point: Array, axes: Array, goal: Array, outputs: Addresses) -> None:
    """Write the error axes (T p) - goal, (m,), along axes (m, 3), and its Jacobian by T, (m, 6)."""
    error, by_pose = error_at(outputs, len(axes)), jacobian_at(outputs, 0, len(axes), 6)
    x, y, z = point[0], point[1], point[2]
    for i in range(len(axes)):
        a, b, c = 0.0, 0.0, 0.0
        error[i] = -goal[i]
        for k in range(3):
            a += axes[i, k] * T[k, 0]
            b += axes[i, k] * T[k, 1]
            c += axes[i, k] * T[k, 2]
            error[i] += axes[i, k] * T[k, 3]
        error[i] += a * x + b * y + c * z
        by_pose[i, 0], by_pose[i, 1], by_pose[i, 2] = y * c - z * b, z * a - x * c, x * b - y * a
        by_pose[i, 3], by_pose[i, 4], by_pose[i, 5] = a, b, c


def _error_of(
    pose: int, point: Array, axes: Array, goal: Array, target: int | None = None
) -> Evaluate:
    """Return the error function; the goal is that of the target, if it is a key."""
    blocks = blocks_of(len(axes), (6,) if target is None else (6, 3))

    def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
        own = blocks.own
        at = goal if target is None else values.atPoint3(target)
        _rows_kernel(values.atPose3(pose).matrix(), point, axes, at, own.outputs)
        if jacobians is not None:
            if target is not None:
                own.views[1][...] = -axes
            own.copy_to(jacobians)
        return own.error

    return error


class PointToPointFactor(Factor):
    """A measured point is a point of the world: error T_world_body p - target, metres.

    Parameters
    ----------
    measured
        (3,) point in the sensor's frame, metres.
    target
        (3,) point in the world, or the key of a Point3 there.
    model
        Noise model of dimension 3, of the error in the world's frame.
    pose
        Key of a Pose3 T_world_body.
    T_body_sensor
        (4, 4) pose of the sensor in the body, or gtsam.Pose3; by default they are the same.

    Raises
    ------
    ValueError
        If a point is not three finite numbers or the noise has another dimension; and see `Factor`.
    """

    measured: Array

    def __init__(
        self,
        measured: ArrayLike,
        target: ArrayLike | int,
        model: gtsam.noiseModel.Base,
        pose: int,
        T_body_sensor: Pose | None = None,
    ) -> None:
        checked_noise(model, 3)
        pose = checked_key("pose", pose)
        point, in_body, T_mount = _in_body(measured, T_body_sensor)
        variables, axes = [Variable("pose", pose, POSE3)], np.eye(3)
        goal: int | Array
        if isinstance(target, int | np.integer):
            goal = checked_key("target", int(target))
            variables.append(Variable("target", goal, POINT3))
            error = _error_of(pose, in_body, axes, np.zeros(3), goal)
        else:
            goal = checked_vector("target", target, 3)
            error = _error_of(pose, in_body, axes, goal)
        made_of: dict[str, Any] = {"measured": point, "target": goal, "model": model}
        arguments = {**made_of, "pose": pose, "T_body_sensor": T_mount}
        super().__init__(model, variables, error, arguments)


class PointToPlaneFactor(Factor):
    """A measured point is on a plane of the world: error normal . T_world_body p - distance.

    Parameters
    ----------
    measured
        (3,) point in the sensor's frame, metres.
    normal, distance
        Plane normal . x = distance in the world; (3,) of length 1, and metres.
    model
        Noise model of dimension 1.
    pose
        Key of a Pose3 T_world_body.
    T_body_sensor
        (4, 4) pose of the sensor in the body, or gtsam.Pose3; by default they are the same.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, or the normal has another length; and see
        `Factor`.
    """

    measured: Array
    normal: Array
    distance: float

    def __init__(
        self,
        measured: ArrayLike,
        normal: ArrayLike,
        distance: float,
        model: gtsam.noiseModel.Base,
        pose: int,
        T_body_sensor: Pose | None = None,
    ) -> None:
        checked_noise(model, 1)
        pose, distance = checked_key("pose", pose), checked_number("distance", distance)
        point, in_body, T_mount = _in_body(measured, T_body_sensor)
        n = checked_vector("normal", normal, 3)
        if abs(np.linalg.norm(n) - 1) > 1e-6:
            raise ValueError(f"normal must have length 1, not {np.linalg.norm(n)}")
        error = _error_of(pose, in_body, n[None], np.array([distance]))
        made_of: dict[str, Any] = {"measured": point, "normal": n, "distance": distance}
        arguments = {**made_of, "model": model, "pose": pose, "T_body_sensor": T_mount}
        super().__init__(model, [Variable("pose", pose, POSE3)], error, arguments)
