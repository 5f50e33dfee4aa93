"""Tracks of landmarks through the event images, with how old they are and whether they agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.front_end import TrackedCluster

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

LONGEST = 12
"""Number of latest points of a track that are shown."""
OLD = 0.5
"""Age from which a track has the last colour, seconds."""
YOUNG_COLOUR, OLD_COLOUR, OUTLIER = (80, 190, 90), (10, 70, 60), (210, 20, 20)
"""RGB: inliers from light to dark green, outliers red."""


@dataclass(frozen=True, eq=False)
class Track:
    """A landmark's latest measurements.

    Attributes
    ----------
    left, right
        (N, 2) rectified pixels, the newest last.
    age
        Seconds since it was first seen.
    is_inlier
        It agrees with the velocity of the newest cluster.
    """

    left: Array
    right: Array
    age: float
    is_inlier: bool

    @property
    def colour(self) -> Colour:
        """RGB by age, or that of outliers."""
        if not self.is_inlier:
            return OUTLIER
        share = min(1.0, self.age / OLD)
        mixed = (1 - share) * np.array(YOUNG_COLOUR) + share * np.array(OLD_COLOUR)
        red, green, blue = np.rint(mixed).astype(int).tolist()
        return red, green, blue


class TrackHistory:
    """Collects the measurements of the landmarks that are seen, cluster by cluster."""

    def __init__(self) -> None:
        self._seen: dict[int, Array] = {}
        self._first: dict[int, float] = {}

    def add(self, tracked: TrackedCluster) -> list[Track]:
        """Return the tracks that reach into the newest cluster."""
        earlier, later = tracked.earlier, tracked.later
        numbers = later.landmark.tolist()
        first: dict[int, float] = dict(zip(numbers, earlier.t.tolist(), strict=True))
        before, now = (_pixels(measured.stereo) for measured in (earlier, later))
        known = first | self._first
        self._first = {number: known[number] for number in numbers}
        self._seen = {
            number: np.concatenate([self._seen.get(number, before[k : k + 1]), now[k : k + 1]])[
                -LONGEST:
            ]
            for k, number in enumerate(numbers)
        }
        ages = later.t - np.array([self._first[number] for number in numbers])
        return [
            Track(seen[:, :2], seen[:, 2:], float(age), bool(inlier))
            for seen, age, inlier in zip(self._seen.values(), ages, tracked.inliers, strict=True)
        ]


def _pixels(stereo: Array) -> Array:
    """Return left and right pixels (N, 4) of measurements (N, 3)."""
    u, v, disparity = stereo.T
    return np.column_stack([u, v, u - disparity, v])
