"""Landmarks that were lost, to be known again where the motion brings them back into view."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.array_table import ArrayTable
from gpvo.remembered import remembered
from gpvo.tracking.klt.anchors import Anchors
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.sights import Sights, predict

Array = NDArray[np.float64]

FRAMES = 4
"""Number of frames in which a landmark was seen that is remembered: fewer may be chance matches."""
MARGIN = 8
"""Distance from the image's border at which a landmark is searched, pixels."""


@dataclass(frozen=True, eq=False)
class LastSights(ArrayTable):
    """How N landmarks were seen last, the one that was lost first at the beginning.

    Attributes
    ----------
    landmark
        (N,) identities.
    sights
        Where they were seen last.
    anchors
        How they were seen first.
    """

    landmark: NDArray[np.int64]
    sights: Sights
    anchors: Anchors


class LostLandmarks:
    """The landmarks that were lost last, `size` at most; `last` are their last sights."""

    def __init__(self, size: int, camera: StereoCamera) -> None:
        self._size, self._camera = size, camera
        self.last: LastSights | None = None
        self._first_new: deque[int] = deque(maxlen=FRAMES)

    def follow(self, previous: Frame, frame: Frame, new: int) -> None:
        """Remember what was lost between two frames, and forget what was found in the later one.

        `new` is the least identity of landmarks that are new in the later one: they increase.
        """
        if not self._size:
            return
        self._first_new.append(new)
        lost = ~np.isin(previous.landmark, frame.landmark)
        lost &= previous.landmark < self._first_new[0]
        last = previous.select(lost)
        all_lost = LastSights(last.landmark, last.sights, last.anchors)
        if self.last is not None:
            found = np.isin(self.last.landmark, frame.landmark)
            all_lost = LastSights.concatenate([self.last[~found], all_lost])
        self.last = all_lost[remembered(all_lost.landmark, self._size)]

    def in_view(self, frame: Frame) -> tuple[LastSights, Array] | None:
        """Return landmarks that the motion takes into a frame, and where, (u_left, v, disparity).

        None if there are none.
        """
        if self.last is None:
            return None
        there = predict(self._camera, frame.T_start_cam, self.last.sights)
        height, width = frame.left_image.image.shape
        last = np.array([width, height]) - 1.0 - MARGIN
        inside = np.all((there[:, :2] >= MARGIN) & (there[:, :2] <= last), axis=1)  # not if NaN
        index = np.flatnonzero(inside)
        return (self.last[index], there[index]) if len(index) else None
