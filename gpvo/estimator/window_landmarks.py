"""The landmarks of a window: one factor of its states for all, and what is known from before.

The factor is replaced at each update. What is measured next to states that leave is marginalised:
it leaves a factor of those states, and a prior of the landmarks as they are seen from the first
state that stays. Some landmarks that are not measured in the window any more stay in it: they cost
little, and tie the motion to where it was when they are found again.
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors import LandmarkPrior, StatesBetween, StructurelessStereoFactor, marginalize
from factors.structureless.identities import are_in, increasing, repeated
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.state_times import SAME_TIME
from gpvo.remembered import remembered
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States, bracket

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
        self._lost = np.empty(0, np.int64)  # the one that was measured longest ago first
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
        self._lost = self._lost[:0]

    def updated(self, added: Sequence[int]) -> None:
        """Note the indices that GTSAM gave to the factors that were added."""
        self.index = None if self._place is None else added[self._place]

    def factor_of(self, window: NumberedStates) -> StructurelessStereoFactor | None:
        """Make the factor of all measurements and the prior; None if they measure no motion."""
        if len(window.states) < 2:
            return None
        landmark = self.measurements.landmark
        known = increasing(repeated(landmark), self._prior.number)
        used = self.measurements[are_in(known, landmark)]
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
        return self._factor.window.states_between(window.states.T_world_cam, window.states.twist)

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
            number, tracked = factor.landmark_numbers, self.measurements.landmark[stays]
            away = ~are_in(increasing(tracked), number)
            lost = away & ~self._are_lost(number)
            drift = self._drift(number, lost, start - window.states.t[0])
            self._remember(number[lost], number[away])
            kept = number[~away | self._are_lost(number)]
            marginal = marginalize(factor, window.values(), leaving, others, kept, drift)
            update.add_factors([marginal.factor])
            self._prior = marginal.prior
        self.measurements = self.measurements[stays]

    def _are_lost(self, number: Index) -> NDArray[np.bool_]:
        """Tell which landmarks (L,) were lost, and are remembered."""
        return are_in(np.sort(self._lost), number)

    def _drift(self, number: Index, lost: NDArray[np.bool_], duration: float) -> Array:
        """(L, 3) standard deviations of what landmarks have moved in some seconds, pixels.

        A track walks at random on its landmark. One that is lost now (L,) may be found again
        elsewhere on it, and stays what it is meanwhile.
        """
        walk = self._build.noise.track_drift * np.sqrt(duration)
        jump = lost * self._build.noise.known_again
        moves = ~self._are_lost(number)
        return np.repeat(np.hypot(walk * moves, jump)[:, None], 3, axis=1)

    def _remember(self, lost: Index, away: Index) -> None:
        """Remember landmarks that are lost now, and of the others still away."""
        lost = np.concatenate([self._lost[are_in(away, self._lost)], lost])
        self._lost = lost[remembered(lost, self._build.config.lost_landmarks)]

    def _follow(self, update: GraphUpdate, window: NumberedStates) -> None:
        self._factor, self._state_count = self.factor_of(window), len(window.states)
        self._place = None if self._factor is None else len(update.factors)
        update.add_factors([] if self._factor is None else [self._factor])


def merged_states(keys: States, between: StatesBetween | None, measured: Array) -> States:
    """Return key states and those at the measured times (N,) between them, in order of time."""
    if len(keys) < 2:
        return keys
    t = np.sort(measured[(measured > keys.t[0]) & (measured < keys.t[-1])])
    if len(t) == 0:
        return keys
    before, after = bracket(keys.t, t)
    distance = np.minimum(t - keys.t[before], keys.t[after] - t)
    t = t[(distance > SAME_TIME) & (np.diff(t, prepend=-np.inf) > SAME_TIME)]
    T, twist = keys.query(t) if between is None else between.states(t)
    both = States.concatenate([keys, States(t, T, twist)])
    return both[np.argsort(both.t, kind="stable")]
