"""Where landmarks were seen in the rectified stereo frames of clusters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Observations:
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
        where unknown; None if the tracker has no times of its own. What is unknown is told by the
        events around the pixel.
    """

    landmark: NDArray[np.int64]
    frame: NDArray[np.int64]
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    own_times: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.landmark)

    def __getitem__(self, index: NDArray) -> Observations:
        return Observations(
            self.landmark[index],
            self.frame[index],
            self.left[index],
            self.right[index],
            self.times[index],
        )

    @property
    def disparity(self) -> NDArray[np.float64]:
        """(N,) left column minus right column, pixels."""
        return self.left[:, 0] - self.right[:, 0]

    @property
    def times(self) -> NDArray[np.float64]:
        """(N, 2) the tracker's own times, left and right, seconds; NaN where it has none."""
        return np.full((len(self), 2), np.nan) if self.own_times is None else self.own_times

    @staticmethod
    def concatenate(parts: Iterable[Observations]) -> Observations:
        """Join several sets of observations, one at least."""
        columns = [(part.landmark, part.frame, part.left, part.right, part.times) for part in parts]
        return Observations(*(np.concatenate(column) for column in zip(*columns, strict=True)))
