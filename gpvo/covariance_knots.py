"""Joint covariances of neighbouring states, kept at knots a few milliseconds apart.

Between knots the Gaussian process interpolates covariances exactly, so that not every state's need
be kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpvo.factor_graph import FactorMaker, seen_twice, state_times
from gpvo.states import States
from gpvo.tracklets import Measurements
from gpvo.window import Window

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CovarianceKnots:
    """Times of M states, and how each and the next are uncertain together.

    Attributes
    ----------
    t
        (M,) times of states, seconds.
    joint
        (M - 1, 24, 24) joint covariances of pose and twist of one knot, then of the next.
    """

    t: Array = field(default_factory=lambda: np.empty(0))
    joint: Array = field(default_factory=lambda: np.empty((0, 24, 24)))

    @staticmethod
    def joined(parts: Sequence[CovarianceKnots]) -> CovarianceKnots:
        """Knots of parts in order of time; each part's first is the last one of the part before."""
        parts = [part for part in parts if len(part.t)]
        if not parts:
            return CovarianceKnots()
        t = [parts[0].t, *(part.t[1:] for part in parts[1:])]
        return CovarianceKnots(np.concatenate(t), np.concatenate([part.joint for part in parts]))

    def next_until(
        self,
        stop: float,
        states: States,
        measurements: Measurements,
        make: FactorMaker,
        interval: float,
        first_deviations: Array,
    ) -> CovarianceKnots:
        """Knots from the last one to the state at `stop`, given the measurements around it.

        The graph has states at knots alone, `interval` seconds apart, and measurements between them
        are interpolated. `first_deviations` (12,) are those of the trajectory's first state.
        """
        start = self.t[-1] if len(self.t) else states.t[0]
        if stop <= start:
            return CovarianceKnots()
        inner = states.t[states.t > start]
        final = np.append(state_times(inner[inner < stop - interval / 2], interval, start), stop)
        later = state_times(inner, interval, stop)
        t = np.concatenate([[start], final, later])
        inside = (measurements.t >= t[0]) & (measurements.t <= t[-1])
        window = Window(
            states.at(t),
            seen_twice(measurements[inside]),
            self._anchor_covariance(first_deviations),
        )
        return CovarianceKnots(t[: 1 + len(final)], window.joint_covariances(make, len(final)))

    def _anchor_covariance(self, first_deviations: Array) -> Array:
        """(12, 12) of the last knot: what is known of its pose so far, of its twist nothing.

        The window's measurements, not the earlier ones that it shares with the last window, tell
        the twist.
        """
        covariance = np.diag(first_deviations**2)
        if len(self.joint):
            covariance[:6, :6] = self.joint[-1, 12:18, 12:18]
        return covariance
