"""Covariance knots of a segment: those of states that left the window, and the next ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StatesBetween
from gpvo.estimator.isam2 import blocks_of_neighbours
from gpvo.estimator.state_times import state_times
from gpvo.trajectory.covariance_knots import CovarianceKnots

Array = NDArray[np.float64]


class WindowKnots:
    """The knots until now, `interval` seconds apart and at all key states."""

    def __init__(self, interval: float) -> None:
        self._interval = interval
        self._parts: list[CovarianceKnots] = []

    @property
    def nbytes(self) -> int:
        """Size of the arrays."""
        return sum(part.nbytes for part in self._parts)

    @property
    def last_covariance(self) -> Array | None:
        """(12, 12) of the state at the last knot, None if there is none."""
        return self._parts[-1].joint[-1, 12:, 12:] if self._parts else None

    def extend(self, later: CovarianceKnots) -> None:
        """Add the next knots."""
        if len(later.t):
            self._parts[-1:] = CovarianceKnots.extended(self._parts[-1:], later)

    def followed_by(self, later: CovarianceKnots) -> CovarianceKnots:
        """Return all knots and the next ones."""
        return CovarianceKnots.joined(CovarianceKnots.extended(self._parts, later))

    def next_times(self, known: Array, t_keys: Array) -> Array:
        """Return the times of the next knots, from the last one on: of known states and key states.

        The first key state is the last knot, if there are any.
        """
        start = self._parts[-1].t[-1] if self._parts else t_keys[0]
        between = state_times(known[known > start], self._interval, start)
        return np.unique(np.concatenate([[start], between, t_keys[t_keys > start]]))


def joint_covariances(
    t: Array, t_keys: Array, covariance: Array, between: StatesBetween | None
) -> Array:
    """(n - 1, 24, 24) of states at times (n,), of each and the next.

    `covariance` (12 K, 12 K) is that of the key states. Without states between these the times are
    theirs.
    """
    if between is not None:
        return between.joint_covariances(t, covariance)
    columns = (12 * np.searchsorted(t_keys, t)[:, None] + np.arange(12)).ravel()
    return blocks_of_neighbours(covariance[np.ix_(columns, columns)])
