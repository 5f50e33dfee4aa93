"""Where a trajectory begins: at the first cluster in which enough landmarks hold the pose."""

from __future__ import annotations

import numpy as np

from gpvo.tracking.measurements import Measurements

PATIENCE = 0.5
"""Time after the first measurement at which a trajectory begins with whatever there is, seconds."""


class Beginning:
    """Keeps measurements back until a cluster has at least `least` of them.

    The first pose is the world: what it is off by, all poses are. While the first contours gather,
    a handful of landmarks hold it badly, and the next cluster has ten times as many.
    """

    def __init__(self, least: int) -> None:
        self._least, self._waiting = least, Measurements.concatenate([])
        self._has_begun = least == 0

    def add(self, stop: float, added: Measurements) -> Measurements:
        """Return what may be estimated of all that clusters until `stop`, seconds, have added."""
        if self._has_begun:
            return added
        self._waiting = Measurements.concatenate([self._waiting, added])
        if not len(self._waiting):
            return added
        frame, count = np.unique(self._waiting.frame, return_counts=True)
        held = frame[count >= self._least]
        if len(held):
            return self._begin(int(held[0]))
        if stop - self._waiting.t.min() >= PATIENCE:
            return self._begin(int(frame[0]))
        return self._waiting[:0]

    def end(self) -> Measurements:
        """Return what still waits after the last cluster."""
        return self._begin(0)

    def _begin(self, frame: int) -> Measurements:
        """Return what waits, from a cluster's number on."""
        waiting, self._waiting = self._waiting, self._waiting[:0]
        self._has_begun = True
        return waiting[waiting.frame >= frame]
