"""The spaces that trajectories live in, each a part of SE(3), or of vectors.

A rotation is a transform without translation and a planar pose one in the plane z = 0, and their
tangents are some of the six columns of SE(3)'s. What is exact there is exact here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import gtsam
import numpy as np

from factors.kernels import Array
from factors.variables import POSE2, POSE3, ROT3, Kind


class Space(NamedTuple):
    """A group of motions within SE(3).

    Attributes
    ----------
    kind
        What its variables are.
    columns
        Where its tangent is among (rotation, translation).
    to_transform, from_transform
        Between GTSAM's object and the transform (4, 4).
    """

    kind: Kind
    columns: tuple[int, ...]
    to_transform: Callable[[Any], Array]
    from_transform: Callable[[Array], Any]


def _of_pose2(pose: gtsam.Pose2) -> Array:
    angle, x, y = pose.theta(), pose.x(), pose.y()
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])


def _of_rot3(rotation: gtsam.Rot3) -> Array:
    T = np.eye(4)
    T[:3, :3] = rotation.matrix()
    return T


IN_SPACE = Space(
    POSE3,
    (0, 1, 2, 3, 4, 5),
    lambda pose: np.ascontiguousarray(pose.matrix()),
    lambda T: gtsam.Pose3(T),
)
IN_PLANE = Space(
    POSE2,
    (3, 4, 2),  # GTSAM's order is x, y, angle
    _of_pose2,
    lambda T: gtsam.Pose2(T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])),
)
ROTATIONS = Space(ROT3, (0, 1, 2), _of_rot3, lambda T: gtsam.Rot3(T[:3, :3]))
