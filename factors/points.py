"""Factors of points that a sensor on the body measures, of a lidar or a depth camera."""

from __future__ import annotations

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
from factors.kernels.points import point_kernel
from factors.kernels.se3 import Array
from factors.variables import POINT3, POSE3, Variable


def _in_body(measured: ArrayLike, T_body_sensor: Pose | None) -> tuple[Array, Array, Array | None]:
    """Check a measured point; return it, it in the body's frame, and the sensor's pose there."""
    point = checked_vector("measured", measured, 3)
    if T_body_sensor is None:
        return point, point, None
    T = checked_pose("T_body_sensor", T_body_sensor)
    return point, T[:3, :3] @ point + T[:3, 3], T


class PointError:
    """Error axes (T p) - goal of a point p on the body, along axes of the world.

    Attributes
    ----------
    point
        (3,) p in the body's frame.
    lines
        (m, 4) axes, and the goal along each.
    """

    def __init__(self, pose: int, point: Array, axes: Array, goal: Array) -> None:
        self.point, self.lines, self._pose = point, np.column_stack([axes, goal]), pose
        self._blocks = blocks_of(len(axes), (6,))

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        own = self._blocks.own
        point_kernel(values.atPose3(self._pose).matrix(), self.point, self.lines, own.outputs)
        if jacobians is not None:
            own.copy_to(jacobians)
        return own.error


def _error_to_landmark(pose: int, point: Array, target: int) -> Evaluate:
    """Return the error T p - target of a target that is a variable."""
    lines, blocks = np.eye(3, 4), blocks_of(3, (6, 3))

    def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
        own = blocks.own
        point_kernel(values.atPose3(pose).matrix(), point, lines, own.outputs)
        if jacobians is not None:
            own.views[1][...] = -np.eye(3)
            own.copy_to(jacobians)
        return own.error - values.atPoint3(target)

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
        variables = [Variable("pose", pose, POSE3)]
        goal: int | Array
        error: Evaluate
        if isinstance(target, int | np.integer):
            goal = checked_key("target", int(target))
            variables.append(Variable("target", goal, POINT3))
            error = _error_to_landmark(pose, in_body, goal)
        else:
            goal = checked_vector("target", target, 3)
            error = PointError(pose, in_body, np.eye(3), goal)
        made_of = {
            "measured": point,
            "target": goal,
            "model": model,
            "pose": pose,
            "T_body_sensor": T_mount,
        }
        super().__init__(model, variables, error, made_of)


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
        error = PointError(pose, in_body, n[None], np.array([distance]))
        made_of = {
            "measured": point,
            "normal": n,
            "distance": distance,
            "model": model,
            "pose": pose,
            "T_body_sensor": T_mount,
        }
        super().__init__(model, [Variable("pose", pose, POSE3)], error, made_of)
