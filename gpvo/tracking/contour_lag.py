"""How far contours are seen behind where they are.

A pixel has an event when its brightness has changed by the threshold C since its last one. Where a
brightness that rose begins to fall, it must first fall by what it rose since that event, and by C.
So the events of each slope come late, by C / 2 in brightness on average, and a contour is seen
C / (2 |gradient|) behind where it is, against the direction of its motion, however fast it is. Like
the play of a gear this changes only after the motion has turned, and with the way since.

Where a picture moves farther, more of its weak contours are seen, which lag more. Against the true
motion of 28 simulated recordings, the lag of patches is 0.2 pixels where a cluster moves by 0.5
pixels, 0.4 by 2, 0.55 by 5 and 0.75 by 15: it grows with the cube root of that way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.tracking.event_sums import Flow, motion_at

Array = NDArray[np.float64]

WAY = 0.5
"""Way in a new direction after which most of the lag has turned, pixels."""
USUAL = 2.2
"""Way in a cluster of usual length, pixels."""
FARTHEST = 20.0
"""Way in a cluster beyond which the lag stays, pixels."""


class ContourLag:
    """Lag of contours at each place of an image, which follows the image motion.

    `lag` is its size where clusters move by the USUAL way, pixels.
    """

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self._behind: Flow = np.zeros((1, 1, 2), np.float32)

    def follow(self, flow: Flow, dt: float, duration: float) -> Flow:
        """Turn the lag by the image motion (rows, columns, 2), pixels per second, of a cluster.

        dt is the time since the one before, of which the pictures show `duration`, seconds. Returns
        by how much the lag turned at each place, pixels.
        """
        speed = np.maximum(np.linalg.norm(flow, axis=2, keepdims=True), 1e-9)
        way = speed * duration
        lag = self._lag * np.cbrt(np.minimum(way, FARTHEST) / USUAL) / speed * flow
        change = (1 - np.exp(-speed * dt / WAY)) * (lag - self._behind)
        self._behind = np.asarray(self._behind + change, np.float32)
        return change

    def ahead(self, points: Array) -> Array:
        """Return the way (N, 2) from contours that are seen at points (N, 2) to where they are."""
        return motion_at(self._behind, points)
