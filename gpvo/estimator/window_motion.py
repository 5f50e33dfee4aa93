"""The motion priors of a window: Q_c is that which is known now, also for what was measured before.

While Q_c is learned, a motion that becomes livelier is known to be only after some of it was
smoothed too much. The WNOA priors between the key states that stay are therefore replaced at each
update; what leaves the window is marginalised with the ones that it was estimated with. Those of
the latest updates are about the acceleration before them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator.acceleration_ahead import AccelerationAhead
from gpvo.estimator.dead_reckoning import DeadReckoning
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.trajectory.states import States

Array = NDArray[np.float64]


class WindowMotion:
    """The WNOA priors between the key states, and what is guessed of velocities."""

    def __init__(self, build: GraphBuilder, reckoning: DeadReckoning) -> None:
        self._build, self._reckoning = build, reckoning
        self._ahead = AccelerationAhead(build.noise.acceleration_memory)
        self._index: dict[int, int] = {}  # in GTSAM's graph, by the number of the earlier state
        self._earlier, self._place = range(0), 0  # of the latest priors, in the update

    def extend(self, known: States, start: float, stop: float) -> None:
        """Go on from `start` to `stop`, seconds, as the states (K,) did that are known."""
        self._reckoning.extend(start, stop)
        before = known[:0] if self._reckoning.in_window else known
        self._ahead.extend(before, start, stop)

    def acceleration(self, t: Array) -> Array:
        """Return the mean (K - 1, 6) of the acceleration between states at times t (K,)."""
        return self._ahead.between(t)

    @property
    def latest_acceleration(self) -> Array:
        """Mean (6,) of the acceleration in the latest update."""
        return self._ahead.latest

    def follow(self, update: GraphUpdate, window: NumberedStates, known: int) -> None:
        """Replace the priors by those between the states that stay; the first `known` have some."""
        numbers, t = window.numbers, window.states.t
        update.removed += [index for number, index in self._index.items() if number >= numbers[0]]
        self._earlier, self._place = numbers[:-1], len(update.factors)
        density = self._reckoning.densities(t, self._build.qc)
        update.add_factors(self._build.motion(numbers, t, density, self.acceleration(t)))
        update.add_factors(self._reckoning.at_rest(numbers[known - 1 :], t[known - 1 :]))

    def add_all_to(self, update: GraphUpdate, window: NumberedStates) -> None:
        """Add all to a new smoother."""
        self._index.clear()
        self.follow(update, window, 1)

    def updated(self, added: Sequence[int]) -> None:
        """Note the indices that GTSAM gave to the factors that were added."""
        self._index = {number: added[self._place + k] for k, number in enumerate(self._earlier)}
