"""Stereo measurements of landmarks, each at its own time: what the estimator is given."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Measurements:
    """N stereo measurements of landmarks, each at its own time.

    Attributes
    ----------
    landmark
        (N,) int64 identity of the landmark.
    frame
        (N,) int64 number of the cluster that it was seen in.
    t
        (N,) float64 seconds.
    stereo
        (N, 3) float64 (u_left, v, disparity), rectified pixels.
    """

    landmark: NDArray[np.int64]
    frame: NDArray[np.int64]
    t: NDArray[np.float64]
    stereo: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, index: NDArray | slice) -> Measurements:
        return Measurements(
            self.landmark[index], self.frame[index], self.t[index], self.stereo[index]
        )

    @staticmethod
    def concatenate(parts: Iterable[Measurements]) -> Measurements:
        """Join several sets of measurements."""
        columns = [(part.landmark, part.frame, part.t, part.stereo) for part in parts]
        if not columns:
            return Measurements(
                np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty((0, 3))
            )
        return Measurements(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def seen_twice(measurements: Measurements) -> Measurements:
    """The measurements of landmarks that have at least two; one alone tells no motion."""
    landmarks, count = np.unique(measurements.landmark, return_counts=True)
    return measurements[np.isin(measurements.landmark, landmarks[count >= 2])]
