"""The landmarks of a window: one factor of its states for all, and what is known from before.

The factor is replaced at each update. What is measured next to states that leave is marginalised:
it leaves a factor of those states, and a prior of the landmarks as they are seen from the first
state that stays. So a landmark is known for as long as it is measured again within the window.
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors import LandmarkPrior, StatesBetween, StructurelessStereoFactor, marginalize
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.state_times import SAME_TIME
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States, bracket

Array = NDArray[np.float64]


class WindowLandmarks:
    """The measurements in the window, in a factor that is replaced at each update.

    Attributes
    ----------
    measurements
        Those since the window's first state.
    """

    def __init__(self, build: GraphBuilder) -> None:
        self._build = build
        self.measurements = Measurements.concatenate([])
        self._prior = LandmarkPrior.none()
        self._factor: StructurelessStereoFactor | None = None
        self._state_count = 0
        self._place: int | None = None
        self.index: int | None = None
        """Where the factor is in GTSAM's graph."""

    def add_to(
        self,
        update: GraphUpdate,
        window: NumberedStates,
        new: Measurements,
        leaving: int,
        others: gtsam.NonlinearFactorGraph,
    ) -> None:
        """Replace the factor by one of all measurements, except those next to states that leave.

        `leaving` is the number of these; `others` are the other factors on them.
        """
        if leaving:
            self._let_go(update, window, new, leaving, others)
        else:
            self.measurements = Measurements.concatenate([self.measurements, new])
        update.removed += [] if self.index is None else [self.index]
        self._follow(update, window.after(leaving))

    def add_all_to(self, update: GraphUpdate, window: NumberedStates, forget: bool) -> None:
        """Add all measurements in the window to a new smoother; the prior may be forgotten."""
        self.measurements = self.measurements[self.measurements.t >= window.states.t[0]]
        if forget:
            self._prior = LandmarkPrior.none()
        self.index = None
        self._follow(update, window)

    def clear(self) -> None:
        """Forget all landmarks."""
        self.measurements, self._prior = self.measurements[:0], LandmarkPrior.none()

    def updated(self, added: Sequence[int]) -> None:
        """Note the indices that GTSAM gave to the factors that were added."""
        self.index = None if self._place is None else added[self._place]

    def factor_of(self, window: NumberedStates) -> StructurelessStereoFactor | None:
        """Make the factor of all measurements and the prior; None if they measure no motion."""
        if len(window.states) < 2:
            return None
        number, count = np.unique(self.measurements.landmark, return_counts=True)
        known = np.union1d(number[count >= 2], self._prior.number)
        used = self.measurements[np.isin(self.measurements.landmark, known)]
        if len(used) + len(self._prior) == 0:
            return None
        return self._build.structureless(window.numbers, window.states.t, used, self._prior)

    @property
    def factor(self) -> StructurelessStereoFactor | None:
        """The factor in the graph, None if there is none."""
        return self._factor

    def points(self, window: NumberedStates) -> tuple[NDArray[np.int64], Array]:
        """Return (L,) identities of the landmarks and the (L, 3) points that fit best."""
        if self._factor is None:
            return np.empty(0, np.int64), np.empty((0, 3))
        return self._factor.landmarks(window.values())

    def states_between(self, window: NumberedStates) -> StatesBetween | None:
        """Return the states at unique times, given those of the window as they are now."""
        if self._factor is None:
            return None
        return self._factor.states_between(window.values())

    def _let_go(
        self,
        update: GraphUpdate,
        window: NumberedStates,
        new: Measurements,
        leaving: int,
        others: gtsam.NonlinearFactorGraph,
    ) -> None:
        """Marginalise what was measured before the first state that stays."""
        start = window.states.t[leaving]
        late = bool((new.t < start).any())
        self.measurements = Measurements.concatenate([self.measurements, new])
        stays = self.measurements.t >= start
        # The factor that GTSAM has is linearised already, and knows all unless some came late.
        reaches = self._factor is not None and leaving < self._state_count
        factor = self._factor if reaches and not late else self.factor_of(window)
        if factor is not None:
            marginal = marginalize(
                factor,
                window.values(),
                leaving,
                others,
                self._known_on(stays),
                self._drift(start - window.states.t[0]),
            )
            update.add_factors([marginal.factor])
            self._prior = marginal.prior
        self.measurements = self.measurements[stays]

    def _known_on(self, stays: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Landmarks that are measured in the window; all while none is, as they may come back."""
        if stays.any():
            return np.unique(self.measurements.landmark[stays])
        return np.union1d(self._prior.number, self.measurements.landmark)

    def _drift(self, duration: float) -> Array:
        """(3,) standard deviation of a track's random walk on its landmark, pixels."""
        return np.full(3, self._build.noise.track_drift * np.sqrt(duration))

    def _follow(self, update: GraphUpdate, window: NumberedStates) -> None:
        self._factor, self._state_count = self.factor_of(window), len(window.states)
        self._place = None if self._factor is None else len(update.factors)
        update.add_factors([] if self._factor is None else [self._factor])


def merged_states(keys: States, between: StatesBetween | None, measured: Array) -> States:
    """Return key states and those at the measured times (N,) between them, in order of time."""
    if len(keys) < 2:
        return keys
    t = np.unique(measured[(measured > keys.t[0]) & (measured < keys.t[-1])])
    if len(t) == 0:
        return keys
    before, after = bracket(keys.t, t)
    distance = np.minimum(t - keys.t[before], keys.t[after] - t)
    t = t[(distance > SAME_TIME) & (np.diff(t, prepend=-np.inf) > SAME_TIME)]
    T, twist = keys.query(t) if between is None else between.states(t)
    both = States.concatenate([keys, States(t, T, twist)])
    return both[np.argsort(both.t, kind="stable")]
