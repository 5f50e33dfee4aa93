"""Smooth random motions of the camera, with exact poses and body twists."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from gpvo.errors import InputError
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

Array = NDArray[np.float64]
MotionName = Literal[
    "hand_held", "fast", "rotation", "back_and_forth", "corridor", "driving", "still"
]

SPEEDS: dict[MotionName, float] = {"corridor": 0.7, "driving": 8.0}
"""Speed along x of the world, m/s; 0 for the others."""

_R_WORLD_AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""A level camera that looks along x of the world, whose z points up."""


class _Style(NamedTuple):
    """Half widths of the box of random waypoints, and seconds between them."""

    reach: tuple[float, float, float]  # x, y, z of the world, metres
    turn: tuple[float, float, float]  # pitch, yaw, roll: x, y, z of the camera, radians
    interval: float


_STYLES: dict[MotionName, _Style] = {
    "hand_held": _Style((0.5, 0.6, 0.3), (0.10, 0.20, 0.10), 1.2),
    "fast": _Style((0.5, 0.6, 0.3), (0.2, 0.4, 0.2), 0.5),
    "rotation": _Style((0.0, 0.0, 0.0), (0.3, 0.6, 0.3), 0.8),
    "back_and_forth": _Style((0.05, 0.6, 0.05), (0.03, 0.03, 0.03), 1.2),
    "corridor": _Style((0.0, 0.15, 0.1), (0.05, 0.1, 0.05), 1.0),
    "driving": _Style((0.0, 0.3, 0.05), (0.01, 0.05, 0.01), 1.5),
    "still": _Style((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """T_world_cam(t) as cubic splines of position and rotation.

    Attributes
    ----------
    position
        Spline of the camera's position in the world, metres.
    rotation
        Spline of R_world_cam.
    offset
        The splines' time at t = 0, seconds.
    """

    position: CubicSpline
    rotation: RotationSpline
    offset: float = 0.0

    @staticmethod
    def random(name: MotionName, duration: float, rng: np.random.Generator) -> Motion:
        """Draw a named motion over [0, duration] seconds that starts near the world's origin."""
        style = _STYLES[name]
        times = np.arange(-1.0, np.ceil(duration / style.interval) + 2.0) * style.interval
        spread = rng.uniform(-1.0, 1.0, (len(times), 6))
        if name == "back_and_forth":
            spread[:, 1] = np.where(np.arange(len(times)) % 2, 1.0, -1.0)
        positions = spread[:, :3] * style.reach
        positions[:, 0] += SPEEDS.get(name, 0.0) * times
        turns = Rotation.from_rotvec(spread[:, 3:] * style.turn)
        rotations = Rotation.from_matrix(_R_WORLD_AHEAD) * turns
        return Motion(CubicSpline(times, positions), RotationSpline(times, rotations))

    @staticmethod
    def through(poses: StampedPoses) -> Motion:
        """Return the motion through given poses, the first at t = 0; the world's z points up.

        Raises
        ------
        InputError
            If there are fewer than two poses.
        """
        if len(poses) < 2:
            raise InputError(f"a motion goes through two poses or more, not {len(poses)}")
        times, rotations = poses.seconds, Rotation.from_matrix(poses.rotations)
        return Motion(CubicSpline(times, poses.positions), RotationSpline(times, rotations))

    @property
    def stop(self) -> float:
        """Time until which the motion is known, seconds."""
        return float(self.position.x[-1]) - self.offset

    def later(self, seconds: float) -> Motion:
        """Return the same motion with t = 0 moved later by `seconds`."""
        return replace(self, offset=self.offset + seconds)

    def pose(self, t: ArrayLike) -> Array:
        """Return T_world_cam (N, 4, 4) at times t (N,), seconds."""
        times = np.atleast_1d(t) + self.offset
        return rigid_transforms(self.rotation(times).as_matrix(), self.position(times))

    def twist(self, t: ArrayLike) -> Array:
        """Return the body twist v (N, 6), rotation first: T(t + dt) = T(t) Exp(v dt) + O(dt**2)."""
        times = np.atleast_1d(t) + self.offset
        angular = self.rotation(times, 1)
        linear = self.rotation(times).inv().apply(self.position(times, 1))
        return np.concatenate([angular, linear], axis=1)
