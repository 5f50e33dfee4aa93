"""The landmarks of a window: one factor of its states for all, and what is known from before.

The factor is replaced at each update. What is measured next to states that leave is marginalised:
it leaves a factor of those states, and a prior of the landmarks as they are seen from the first
state that stays. Some landmarks that are not measured in the window any more stay in it: they cost
little, and tie the motion to where it was when they are found again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors import LandmarkPrior, StatesBetween, StructurelessStereoFactor, marginalize
from factors.structureless.identities import are_in, increasing, repeated
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates, graph_of
from gpvo.estimator.known_landmarks import KnownLandmarks, track_drift
from gpvo.estimator.landmark_looks import Looks
from gpvo.estimator.state_times import SAME_TIME
from gpvo.remembered import remembered
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States, bracket

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Marginalised:
    """What is left of measurements next to states that leave.

    Attributes
    ----------
    factors
        Of the states that leave, and the first that stays.
    known
        Of the landmarks, given that one.
    """

    factors: list[gtsam.NonlinearFactor]
    known: KnownLandmarks


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
        self._known = KnownLandmarks.none()
        self._factor: StructurelessStereoFactor | None = None
        self._state_count = 0
        self._place: int | None = None
        self.index: int | None = None
        """Where the factor is in GTSAM's graph."""

    def add(self, new: Measurements) -> None:
        """Add measurements; the factor is as it was."""
        self.measurements = Measurements.concatenate([self.measurements, new])

    def follow(
        self, update: GraphUpdate, window: NumberedStates, left: Marginalised | None
    ) -> None:
        """Replace the factor by one of all measurements in the window, after some `left` it."""
        if left is not None:
            update.add_factors(left.factors)
            self._known = left.known
            self.measurements = self.measurements[self.measurements.t >= window.states.t[0]]
        update.removed += [] if self.index is None else [self.index]
        self._follow(update, window)

    def add_all_to(self, update: GraphUpdate, window: NumberedStates, forget: bool) -> None:
        """Add all measurements in the window to a new smoother; the prior may be forgotten."""
        self.measurements = self.measurements[self.measurements.t >= window.states.t[0]]
        if forget:
            self._known = KnownLandmarks.none()
        self.index = None
        self._follow(update, window)

    def clear(self) -> None:
        """Forget all landmarks."""
        self.measurements, self._known = self.measurements[:0], KnownLandmarks.none()

    def updated(self, added: Sequence[int]) -> None:
        """Note the indices that GTSAM gave to the factors that were added."""
        self.index = None if self._place is None else added[self._place]

    def factor_before(
        self, new: Measurements, window: NumberedStates
    ) -> StructurelessStereoFactor | None:
        """Make the factor that predicts new measurements, without them."""
        known = self._known.seen_again(new.landmark, window.states, self._build)
        return self._factor_of(window, known.prior)

    def _factor_of(
        self, window: NumberedStates, prior: LandmarkPrior
    ) -> StructurelessStereoFactor | None:
        """Make the factor of all measurements and the prior; None if they measure no motion."""
        if len(window.states) < 2:
            return None
        landmark = self.measurements.landmark
        known = increasing(repeated(landmark), prior.number)
        used = self.measurements[are_in(known, landmark)]
        if len(used) + len(prior) == 0:
            return None
        return self._build.structureless(window.numbers, window.states.t, used, prior)

    @property
    def factor(self) -> StructurelessStereoFactor | None:
        """The factor in the graph, None if there is none."""
        return self._factor

    @property
    def interval(self) -> float | None:
        """Mean time between consecutive measurements of a landmark, seconds; None if unknown."""
        seen = self.measurements[np.lexsort((self.measurements.t, self.measurements.landmark))]
        intervals = np.diff(seen.t)[seen.landmark[1:] == seen.landmark[:-1]]
        return float(intervals.mean()) if len(intervals) else None

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

    def marginalised(
        self,
        window: NumberedStates,
        leaving: int,
        others: Sequence[gtsam.NonlinearFactor],
    ) -> Marginalised:
        """Marginalise what was measured before the first state that stays.

        `leaving` is the number of states before it, `others` are the other factors on them. The
        factor that GTSAM has is linearised already; it is used if it has those states.

        Raises
        ------
        RuntimeError, ValueError
            If the states cannot be told apart; a factor of a user's own raises what it likes.
        """
        start = window.states.t[leaving]
        reaches = self._factor is not None and leaving < self._state_count
        known = self._known
        factor = self._factor if reaches else self._factor_of(window, known.prior)
        if factor is None:
            return Marginalised([], known)
        number = factor.landmark_numbers
        tracked = self.measurements.landmark[self.measurements.t >= start]
        away, known_lost = ~are_in(increasing(tracked), number), are_in(np.sort(known.lost), number)
        lost = self._remembered(number[away & ~known_lost], number[away])
        kept = number[~away | are_in(np.sort(lost), number)]
        looks = self._looks(factor, window, leaving)
        drift = track_drift(self._build.noise, known.looks.change_to(looks))
        left = marginalize(factor, window.values(), leaving, graph_of(others), kept, drift)
        looks = looks[are_in(left.prior.number, number)]
        return Marginalised([left.factor], KnownLandmarks(left.prior, lost, looks))

    def _looks(
        self, factor: StructurelessStereoFactor, window: NumberedStates, leaving: int
    ) -> Looks:
        """Return how landmarks look from the first state that stays, if tracked, or did before."""
        between, number = factor.window.between, factor.window.landmarks.number
        tracked = ~are_in(np.sort(self._known.lost), number)
        fit = factor.window.moved_fit(*between.read(window.values()), leaving + 1)
        T_world_cam, twist = window.states.T_world_cam[leaving], window.states.twist[leaving]
        duration = window.states.t[leaving] - window.states.t[0]
        now = Looks.seen(number[tracked], fit.points()[tracked], T_world_cam, twist, duration)
        return self._known.looks.updated(self._known.looks.turned_to(now))

    def _remembered(self, lost: Index, away: Index) -> Index:
        """Return the landmarks that are lost now, and of the others those still away."""
        lost = np.concatenate([self._known.lost[are_in(away, self._known.lost)], lost])
        return lost[remembered(lost, self._build.config.lost_landmarks)]

    def _follow(self, update: GraphUpdate, window: NumberedStates) -> None:
        landmark, states = self.measurements.landmark, window.states
        self._known = self._known.seen_again(landmark, states, self._build)
        self._factor = self._factor_of(window, self._known.prior)
        self._state_count = len(states)
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
