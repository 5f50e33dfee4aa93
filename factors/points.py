"""Factors of points that a sensor on the body measures, of a lidar or a depth camera."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Pose, checked_noise, checked_pose, checked_vector
from factors.factor import Factor
from factors.jacobian_blocks import Jacobians, fill
from factors.kernels import Array
from factors.lie import skew
from factors.variables import POINT3, POSE3, Variable


def _in_body(measured: ArrayLike, T_body_sensor: Pose | None) -> tuple[Array, Array, Array | None]:
    """Check a measured point; return it, it in the body's frame, and the sensor's pose there."""
    point = checked_vector("measured", measured, 3)
    if T_body_sensor is None:
        return point, point, None
    T = checked_pose("T_body_sensor", T_body_sensor)
    return point, T[:3, :3] @ point + T[:3, 3], T


def _in_world(T: Array, point: Array) -> tuple[Array, Array]:
    """Return a point of the body in the world, and its Jacobian (3, 6) by the body's pose."""
    R = T[:3, :3]
    return R @ point + T[:3, 3], np.hstack([-R @ skew(point), R])


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
        point, in_body, T_mount = _in_body(measured, T_body_sensor)
        variables, landmark = [Variable("pose", int(pose), POSE3)], None
        goal: int | Array
        if isinstance(target, int | np.integer):
            goal = landmark = int(target)
            variables.append(Variable("target", landmark, POINT3))
        else:
            goal = checked_vector("target", target, 3)

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            found, by_pose = _in_world(values.atPose3(pose).matrix(), in_body)
            if jacobians is not None:
                fill(jacobians, [by_pose] if landmark is None else [by_pose, -np.eye(3)])
            difference: Array = found - (goal if landmark is None else values.atPoint3(landmark))
            return difference

        made_of: dict[str, Any] = {"measured": point, "target": goal, "model": model}
        arguments = {**made_of, "pose": int(pose), "T_body_sensor": T_mount}
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
        point, in_body, T_mount = _in_body(measured, T_body_sensor)
        n = checked_vector("normal", normal, 3)
        if abs(np.linalg.norm(n) - 1) > 1e-6:
            raise ValueError(f"normal must have length 1, not {np.linalg.norm(n)}")
        if not np.isfinite(distance):
            raise ValueError(f"distance must be finite metres, not {distance}")

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            found, by_pose = _in_world(values.atPose3(pose).matrix(), in_body)
            if jacobians is not None:
                fill(jacobians, [n[None] @ by_pose])
            return np.array([n @ found - distance])

        made_of: dict[str, Any] = {"measured": point, "normal": n, "distance": float(distance)}
        arguments = {**made_of, "model": model, "pose": int(pose), "T_body_sensor": T_mount}
        super().__init__(model, [Variable("pose", int(pose), POSE3)], error, arguments)
