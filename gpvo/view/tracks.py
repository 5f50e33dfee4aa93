"""Tracks of landmarks through the event images, with how old they are and whether they agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.front_end import TrackedCluster

Array = NDArray[np.float64]

LONGEST = 12
"""Number of latest points of a track that are shown."""
OLD = 0.5
"""Age from which a track has the last colour, seconds."""
YOUNG_COLOUR, OLD_COLOUR, OUTLIER = (80, 190, 90), (10, 70, 60), (210, 20, 20)
"""RGB: inliers from light to dark green, outliers red."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """The latest measurements of N landmarks.

    Attributes
    ----------
    left, right
        (N, LONGEST, 2) rectified pixels, the newest last; shorter tracks begin with their first
        pixel, several times.
    age
        (N,) seconds since they were first seen.
    inliers
        (N,) bool, they agree with the velocity of the newest cluster.
    """

    left: Array
    right: Array
    age: Array
    inliers: NDArray[np.bool_]

    @property
    def colours(self) -> NDArray[np.uint8]:
        """(N, 3) RGB by age, or that of outliers."""
        share = np.minimum(1.0, self.age / OLD)[:, None]
        mixed = (1 - share) * np.array(YOUNG_COLOUR) + share * np.array(OLD_COLOUR)
        return np.where(self.inliers[:, None], np.rint(mixed), OUTLIER).astype(np.uint8)


class TrackHistory:
    """Collects the measurements of the landmarks that are seen, cluster by cluster."""

    def __init__(self) -> None:
        self._rows: dict[int, int] = {}
        self._pixels, self._first = np.empty((0, LONGEST, 4)), np.empty(0)

    def add(self, tracked: TrackedCluster) -> Tracks:
        """Return the tracks that reach into the newest cluster."""
        earlier, later = tracked.earlier, tracked.later
        landmarks = later.landmark.tolist()
        rows = np.array([self._rows.get(landmark, -1) for landmark in landmarks], np.int64)
        known, before = rows >= 0, _pixels(earlier.stereo)
        pixels, first = np.repeat(before[:, None], LONGEST, axis=1), earlier.t.copy()
        pixels[known], first[known] = self._pixels[rows[known]], self._first[rows[known]]
        pixels = np.concatenate([pixels[:, 1:], _pixels(later.stereo)[:, None]], axis=1)
        self._rows = {landmark: row for row, landmark in enumerate(landmarks)}
        self._pixels, self._first = pixels, first
        return Tracks(pixels[..., :2], pixels[..., 2:], later.t - first, tracked.inliers)


def _pixels(stereo: Array) -> Array:
    """Return left and right pixels (N, 4) of measurements (N, 3)."""
    u, v, disparity = stereo.T
    return np.column_stack([u, v, u - disparity, v])
