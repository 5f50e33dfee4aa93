"""Observations of landmarks in the rectified stereo frames of clusters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable


@dataclass(frozen=True, eq=False)
class Observations(ArrayTable):
    """N stereo observations of landmarks.

    Attributes
    ----------
    landmark
        (N,) int64 identity of the landmark.
    frame
        (N,) int64 number of the stereo frame, counted from 0.
    left, right
        (N, 2) float64 pixel (u, v) in the left and the right image.
    own_times
        (N, 2) float64 seconds at which the landmark was at the left and at the right pixel, NaN
        where unknown; None if the tracker has no times of its own. Unknown times are taken from the
        events around the pixel.
    own_deviations
        (N, 3) standard deviations of u_left, v and disparity as multiples of those of a typical
        observation; None if the tracker does not know.
    """

    landmark: NDArray[np.int64]
    frame: NDArray[np.int64]
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    own_times: NDArray[np.float64] | None = None
    own_deviations: NDArray[np.float64] | None = None

    @property
    def disparity(self) -> NDArray[np.float64]:
        """Disparity (N,): left column minus right column, pixels."""
        return self.left[:, 0] - self.right[:, 0]

    @property
    def times(self) -> NDArray[np.float64]:
        """Times (N, 2) of the tracker, left and right, seconds; NaN where it has none."""
        return np.full((len(self), 2), np.nan) if self.own_times is None else self.own_times

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Relative standard deviations (N, 3); one where the tracker has none."""
        return np.ones((len(self), 3)) if self.own_deviations is None else self.own_deviations

    @classmethod
    def none(cls) -> Observations:
        """Return no observations."""
        number, points = np.empty(0, np.int64), np.empty((0, 2))
        return cls(number, number, points, points)

    @classmethod
    def concatenate(cls, parts: Iterable[Observations]) -> Observations:
        """Join one or more sets of observations."""
        return super().concatenate(
            replace(part, own_times=part.times, own_deviations=part.deviations) for part in parts
        )
