"""Landmarks that GTSAM's smoother never sees: one factor of states alone for all of them.

The factor is replaced whenever there are new measurements. With a state that leaves, what was
measured around it is marginalized and must not change any more. So a landmark is followed for a
window at most, and what is measured of it later is as of another one, as in the multi-state
constraint Kalman filter (Mourikis and Roumeliotis, 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np

from gpvo.estimator.graph_builder import SAME_TIME, FactorMaker
from gpvo.estimator.graph_update import Increment, NumberedStates
from gpvo.estimator.state_times import Lag
from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.trajectory.states import States

GOLDEN = 0.6180339887498949
"""Multiples of it are spread evenly, however many: landmarks that come together leave apart."""


class EliminatedLandmarks:
    """The measurements in the window, in a factor that can be replaced."""

    def __init__(self, make: FactorMaker, lag: Lag) -> None:
        self._make, self._lag = make, lag
        self.used = self._followed = Measurements.concatenate([])
        self._place: int | None = None
        self._index: int | None = None

    def add_to(
        self, increment: Increment, window: NumberedStates, new: Measurements, leave_before: float
    ) -> None:
        """Replace the factor by one of all measurements, but those that leave.

        A landmark leaves with its first measurement next to a state before `leave_before`.
        """
        t = window.states.t
        new = new[new.t >= t[0]]
        self._use(window, new)
        known = Measurements.concatenate([self._followed, self._numbered(new)])
        old = t[np.searchsorted(t, known.t, "right") - 1] < leave_before - SAME_TIME
        leaving = np.isin(known.landmark, known.landmark[old])
        self._followed = known[~leaving]
        increment.add_factors(self._factors(known[leaving], window))
        self._replace(increment, window)

    def add_all_to(self, increment: Increment, window: NumberedStates) -> None:
        """Add all that was measured in the window, to a smoother that is new."""
        self._use(window, self.used[:0])
        self._followed, self._index = self._numbered(self.used), None
        self._replace(increment, window)

    def updated(self, estimate: gtsam.Values, states: States, added: Sequence[int]) -> None:
        """The smoother has taken the factors; `added` are their indices in it."""
        self._index = None if self._place is None else added[self._place]

    def _use(self, window: NumberedStates, new: Measurements) -> None:
        used = Measurements.concatenate([self.used, new])
        self.used = used[used.t >= window.states.t[0]]

    def _numbered(self, measurements: Measurements) -> Measurements:
        """The same, of another landmark in every window; a window's turn differs by landmark."""
        phase = GOLDEN * (1 + measurements.landmark) % 1
        turn = np.floor(self._lag.position + phase).astype(np.int64)
        return replace(measurements, landmark=(measurements.landmark << 20) + turn % (1 << 20))

    def _replace(self, increment: Increment, window: NumberedStates) -> None:
        increment.removed += [] if self._index is None else [self._index]
        factors = self._factors(self._followed, window)
        self._place = len(increment.factors) if factors else None
        increment.add_factors(factors)

    def _factors(
        self, measurements: Measurements, window: NumberedStates
    ) -> list[gtsam.NonlinearFactor]:
        """The factor of the landmarks that are measured twice, if there are any."""
        told = seen_twice(measurements)
        if len(told) == 0:
            return []
        return [self._make.structureless(window.numbers, window.states.t, told)]
