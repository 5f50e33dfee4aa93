"""How landmarks look, which decides where on them their tracks are.

Event cameras see contours across their motion, and a little behind. When the image motion turns, or
a landmark comes nearer, other contours are seen, or the same ones behind in another direction: the
track moves on the landmark. While the motion goes straight on, it stays where it is, for however
long; the variance that is added grows with the change of the look, and hardly with time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.structureless.identities import are_in
from gpvo.array_table import ArrayTable

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WAY = 0.005
"""Way of contours on which pictures come to show another direction of motion, radians: a pixel."""
NEARER = 1.0
"""Change of the look by a landmark that comes e times nearer; by a turn of 60 degrees it is one.

Beside the true motion of twelve recordings it is up to 4 in most, and more along a street and a
corridor; but with more than one the path along the street is farther off.
"""
REVERSED = 2.0
"""Change of the look where contours move the other way: the largest by their direction."""
SLOWEST = 1e-12
"""Least speed that has a direction, rad/s."""


@dataclass(frozen=True, eq=False)
class Looks(ArrayTable):
    """How N landmarks look from where the camera is.

    Attributes
    ----------
    number
        (N,) increasing identities.
    direction
        (N, 3) in which their contours were moving lately, in the world; of length 1 while they go
        straight on.
    distance
        (N,) from the camera, metres.
    """

    number: Index
    direction: Array
    distance: Array

    @classmethod
    def none(cls) -> Looks:
        """Return the looks of no landmark."""
        return cls(np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))

    @classmethod
    def seen(
        cls,
        number: Index,
        points: Array,
        T_world_cam: Array,
        twist: Array,
        duration: float = np.inf,
    ) -> Looks:
        """Return how points (N, 3) look from a pose that has moved at a twist (6,) for a duration.

        The less the contours moved meanwhile, the shorter are the directions.
        """
        local = (points - T_world_cam[:3, 3]) @ T_world_cam[:3, :3]
        distance = np.linalg.norm(local, axis=1)
        ray = local / distance[:, None]
        rate = -twist[3:] / distance[:, None] - np.cross(twist[:3], ray)
        rate -= np.sum(rate * ray, axis=1, keepdims=True) * ray
        speed = np.maximum(np.linalg.norm(rate, axis=1, keepdims=True), SLOWEST)
        shown = 1 - np.exp(-speed * duration / WAY)
        return cls(number, (shown * rate / speed) @ T_world_cam[:3, :3].T, distance)

    def turned_to(self, now: Looks) -> Looks:
        """Return how landmarks look, given what was `seen` since; new ones as they go on."""
        shown = np.linalg.norm(now.direction, axis=1, keepdims=True)
        known, place = self._known(now)
        before = now.direction / np.maximum(shown, SLOWEST)
        before[known] = self.direction[place]
        return Looks(now.number, (1 - shown) * before + now.direction, now.distance)

    def change_to(self, now: Looks) -> Array:
        """Return by how much looks have changed (M,) to those of now; those not known have not."""
        known, place = self._known(now)
        change = np.zeros(len(now))
        turn = np.linalg.norm(now.direction[known] - self.direction[place], axis=1)
        change[known] = turn + NEARER * np.abs(np.log(now.distance[known] / self.distance[place]))
        return change

    def updated(self, now: Looks) -> Looks:
        """Return the looks of all landmarks, those that look otherwise now as they do now."""
        both = Looks.concatenate([self[~are_in(now.number, self.number)], now])
        return both[np.argsort(both.number)]

    def _known(self, now: Looks) -> tuple[NDArray[np.bool_], Index]:
        """Tell which of the landmarks (M,) are known, and the places of those."""
        known = are_in(self.number, now.number)
        return known, np.searchsorted(self.number, now.number[known])
