"""Stereo measurements of landmarks, each at its own time: the input of the estimator."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable


@dataclass(frozen=True, eq=False)
class Measurements(ArrayTable):
    """N stereo measurements of landmarks, each at its own time.

    Attributes
    ----------
    landmark
        (N,) int64 identity of the landmark.
    frame
        (N,) int64 number of the cluster in which it was seen.
    t
        (N,) float64 seconds.
    stereo
        (N, 3) float64 (u_left, v, disparity), rectified pixels.
    own_deviations
        (N, 3) standard deviations of these, as multiples of those that R says; None for all one.
    """

    landmark: NDArray[np.int64]
    frame: NDArray[np.int64]
    t: NDArray[np.float64]
    stereo: NDArray[np.float64]
    own_deviations: NDArray[np.float64] | None = None

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviations (N, 3), as multiples of those that R says."""
        return np.ones((len(self), 3)) if self.own_deviations is None else self.own_deviations

    @classmethod
    def concatenate(cls, parts: Iterable[Measurements]) -> Measurements:
        """Join several sets of measurements."""
        none = Measurements(
            np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty((0, 3))
        )
        return super().concatenate(
            replace(part, own_deviations=part.deviations) for part in [none, *parts]
        )


def seen_twice(measurements: Measurements) -> Measurements:
    """Return the measurements of landmarks that have at least two.

    A single measurement contains no information on the motion.
    """
    landmarks, count = np.unique(measurements.landmark, return_counts=True)
    return measurements[np.isin(measurements.landmark, landmarks[count >= 2])]
