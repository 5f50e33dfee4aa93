"""The spaces that trajectories live in, each a part of SE(3).

A rotation is a transform without translation and a planar pose one in the plane z = 0, and their
tangents are some of the six columns of SE(3)'s. What is exact there is exact here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors.kernels.se3 import Array
from factors.variables import POSE2, POSE3, ROT3, Kind


class Space(NamedTuple):
    """A group of motions within SE(3).

    Attributes
    ----------
    kind
        What its variables are.
    columns
        Where its tangent is among (rotation, translation).
    axes
        Which rows and columns of the transform (4, 4) GTSAM's matrix is.
    from_transform
        Makes GTSAM's object of the transform.
    """

    kind: Kind
    columns: tuple[int, ...]
    axes: tuple[int, ...]
    from_transform: Callable[[Array], Any]

    @property
    def places(self) -> NDArray[np.int64]:
        """Return columns and axes, as kernels take them."""
        return np.array([*self.columns, *self.axes])

    def to_transform(self, pose: Any) -> Array:
        """Return the transform (4, 4) of GTSAM's object."""
        T = np.eye(4)
        T[np.ix_(self.axes, self.axes)] = pose.matrix()
        return T

    def to_twist(self, rate: Array) -> Array:
        """Return the twist (6,) of a rate."""
        twist = np.zeros(6)
        twist[list(self.columns)] = rate
        return twist


IN_SPACE = Space(POSE3, (0, 1, 2, 3, 4, 5), (0, 1, 2, 3), lambda T: gtsam.Pose3(T))
IN_PLANE = Space(
    POSE2,
    (3, 4, 2),  # GTSAM's order is x, y, angle
    (0, 1, 3),
    lambda T: gtsam.Pose2(T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])),
)
ROTATIONS = Space(ROT3, (0, 1, 2), (0, 1, 2), lambda T: gtsam.Rot3(T[:3, :3]))
