"""The window of the fixed-lag smoother: its key states, and GTSAM's smoother of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import StatesBetween
from gpvo.estimator.dead_reckoning import DeadReckoning
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.initialization import InitialState, start_states
from gpvo.estimator.isam2 import (
    KeyStateSmoother,
    are_covariances,
    blocks_of_neighbours,
    prior_covariance,
)
from gpvo.estimator.own_factors import OwnFactors, factors_that_leave
from gpvo.estimator.state_times import SAME_TIME
from gpvo.estimator.window_knots import WindowKnots, joint_covariances
from gpvo.estimator.window_landmarks import Marginalised, WindowLandmarks, merged_states
from gpvo.estimator.window_motion import WindowMotion
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
GUESSED_STEPS = 4
"""More Gauss-Newton steps of an update where some of the motion is guessed, and may be far off."""


@dataclass(frozen=True, eq=False)
class Leaving:
    """States that the next update marginalises: `count` key states, those before a time, seconds.

    With the states between, their covariance knots, and what is left of their measurements; None if
    that is to be found by the update.
    """

    before: float
    count: int
    states: States
    knots: CovarianceKnots
    landmarks: Marginalised | None


NOTHING = Leaving(-np.inf, 0, States(), CovarianceKnots(), None)


class LagWindow:
    """The key states in the lag, what was measured in it, and GTSAM's smoother of both.

    Parameters
    ----------
    build
        Makes the factors.
    own, reckoning
        Factors of a user's own, and what is guessed of the motion.
    initial
        What is known of the first state.
    first
        Its number.

    Attributes
    ----------
    first, own
        Number of the first key state, and factors of a user's own.
    keys
        The key states as estimated now.
    between
        The states at the times between them, given them; None where none is known.
    solved
        How many key states GTSAM has; later ones are predicted.
    motion, landmarks
        The priors of the motion; the measurements in the window, and the factor of them.
    leaves
        The states that leave it with the next update.
    knots
        Covariances of the states that left the window.
    """

    def __init__(
        self,
        build: GraphBuilder,
        own: OwnFactors,
        reckoning: DeadReckoning,
        initial: InitialState,
        first: int = 0,
    ) -> None:
        self._build, self._reckoning, self._initial = build, reckoning, initial
        self.own, self.first = own, first
        self.keys, self.solved = States(), 0
        self.between: StatesBetween | None = None
        self.motion = WindowMotion(build, reckoning)
        self.landmarks = WindowLandmarks(build)
        self.knots = WindowKnots(build.config.covariance_interval)
        self._smoother, self.leaves = KeyStateSmoother(), NOTHING
        self._is_measured = False

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def numbered(self) -> NumberedStates:
        """Key states with their numbers."""
        return NumberedStates(self.first, self.keys)

    @property
    def numbers(self) -> range:
        """Numbers k of the key states X(k), V(k)."""
        return self.numbered.numbers

    @property
    def factors(self) -> gtsam.NonlinearFactorGraph:
        """Factors of the key states as they stand, with what was marginalised; None if removed."""
        return self._smoother.factors

    def linearized(self) -> States | None:
        """Return the states at which the covariance was found; None if GTSAM does not have them."""
        return self._smoother.linearized(self.numbers[: self.solved], self.keys.t[: self.solved])

    def states_until(self, last: int) -> States:
        """Return the states up to the key state number `last`, with those at measured times."""
        measured = self.landmarks.measurements.t if self._build.unique_times else np.empty(0)
        return merged_states(self.keys[: last + 1], self.between, measured)

    @property
    def states(self) -> States:
        """All states, with those at measured times."""
        return self.states_until(len(self) - 1)

    @property
    def first_covariance(self) -> Array:
        """(12, 12) of the first state when it was solved last."""
        known = self.knots.last_covariance
        return self._initial.covariance if known is None else known

    def covariance(self) -> Array:
        """(12 K, 12 K) of the key states that were solved; the prior's alone if GTSAM has none."""
        found = self._smoother.covariance(self.numbers[: self.solved])
        return self._covariance_by_prior(self.keys.t[: self.solved]) if found is None else found

    def knots_of(self, states: States) -> CovarianceKnots:
        """Return the next knots, of the first states, the last one a key state."""
        t_keys = self.keys.t[self.keys.t <= states.t[-1]]
        t = self.knots.next_times(t_keys if self.between is None else states.t, t_keys)
        if len(t) < 2:
            return CovarianceKnots()
        joint = joint_covariances(t, self.keys.t, self.covariance(), self.between)
        if are_covariances(joint):
            return CovarianceKnots(t, joint)
        return CovarianceKnots(t, blocks_of_neighbours(self._covariance_by_prior(t)))

    def what_leaves(self, before: float) -> Leaving:
        """Return the states before a time, seconds, of which at least the last key state stays."""
        before = min(before, self.keys.t[-1])
        count = self.numbered.before(before - SAME_TIME)
        states = self.states_until(count)
        try:
            landmarks = self._marginalised(count)
        except self.own.failures:  # so does the update, which is solved again
            landmarks = None
        return Leaving(before, count, states, self.knots_of(states), landmarks)

    def _marginalised(
        self, count: int, new: Sequence[gtsam.NonlinearFactor] = ()
    ) -> Marginalised | None:
        """Marginalise the measurements next to the first key states; None if `count` is 0.

        `new` are factors that GTSAM does not have yet.
        """
        if count == 0:
            return None
        known = factors_that_leave(self._factors_of_motion(), self.numbered, count)
        return self.landmarks.marginalised(self.numbered, count, [*known, *new])

    def _factors_of_motion(self) -> list[gtsam.NonlinearFactor]:
        """Return GTSAM's factors except that of the landmarks."""
        graph = self.factors
        numbered = ((i, graph.at(i)) for i in range(graph.size()))
        return [
            factor for i, factor in numbered if factor is not None and i != self.landmarks.index
        ]

    def let_leave(self, leaves: Leaving) -> None:
        """Marginalise states at the next update, and keep their covariances."""
        self.leaves = leaves
        self.knots.extend(leaves.knots)

    def begin(self, update: GraphUpdate, t: float, velocity: VelocityFit | None) -> None:
        """Make the first state, at time t."""
        self.keys = start_states(t, velocity, self._initial)
        update.add_states(self.numbered)
        update.add_factors(self._prior_on_first_state())

    def extend(self, update: GraphUpdate, ahead: States) -> None:
        """Add the key states that come next, as they are predicted."""
        last, count, known = float(self.keys.t[-1]), len(self), self.keys[: self.solved]
        self.keys = States.concatenate([self.keys, ahead])
        update.add_states(self.numbered.after(count))
        self.motion.extend(known, last, float(ahead.t[-1]))

    def follow_motion(self, update: GraphUpdate) -> None:
        """Tie the key states that stay by WNOA priors with the Q_c that is known now."""
        leaving = self.leaves.count
        self.motion.follow(update, self.numbered.after(leaving), max(self.solved, 1) - leaving)

    def add_measurements(self, update: GraphUpdate, new: Measurements) -> None:
        """Add new measurements, and marginalise those that leave.

        Raises
        ------
        RuntimeError, IndexError, ValueError
            If that fails; a factor of a user's own raises what it likes.
        """
        count, left = self.leaves.count, self.leaves.landmarks
        self.landmarks.add(new)
        self._is_measured = len(new) > 0
        own = factors_that_leave(update.factors, self.numbered, count)
        if left is None or own:
            left = self._marginalised(count, own)
        self.landmarks.follow(update, self.numbered.after(count), left)

    def solve(self, update: GraphUpdate) -> None:
        """Update GTSAM's smoother, and take over its estimate.

        Raises
        ------
        RuntimeError, IndexError, ValueError
            If that fails; a factor of a user's own raises what it likes.
        """
        more_steps = GUESSED_STEPS if self._is_measured and self._reckoning.in_window else 0
        times = float(self.keys.t[-1]), self.leaves.before
        added = self._smoother.update(update, *times, more_steps)
        self.landmarks.updated(added)
        self.motion.updated(added)
        count = self.leaves.count
        self._leave(self._smoother.states(self.numbers[count:], self.keys.t[count:]))
        self.solved = len(self.keys)
        self.between = self.landmarks.states_between(self.numbered)

    def again(self, forget: bool = False) -> GraphUpdate:
        """Return everything in the window, for a new smoother.

        The landmarks' prior may be forgotten.
        """
        count = self.leaves.count
        if count:
            self._leave(self.keys[count:])
        self._smoother, update = KeyStateSmoother(), GraphUpdate()
        update.add_factors([*self._prior_on_first_state(), *self.own.active])
        self.motion.add_all_to(update, self.numbered)
        update.add_states(self.numbered)
        # A prior is of the first state; with another one it says nothing.
        self.landmarks.add_all_to(update, self.numbered, forget or count > 0)
        return update

    def predict(self) -> None:
        """Forget the measurements, and carry the first state on at its velocity."""
        self.landmarks.clear()
        self.keys = self.keys[:1].at(self.keys.t)

    def give_up(self) -> None:
        """Take the states as they are predicted for solved."""
        self.between, self.solved = None, len(self.keys)

    def _leave(self, stays: States) -> None:
        """Begin the window at the first key state that stays."""
        self.first, self.keys = self.first + self.leaves.count, stays
        self.leaves = NOTHING
        self.own.keep({key(k) for k in self.numbers for key in (X, V)})
        self._reckoning.forget(float(stays.t[0]))

    def _prior_on_first_state(self) -> list[gtsam.NonlinearFactor]:
        T_world_cam, twist = self.keys.T_world_cam[0], self.keys.twist[0]
        covariance = self.first_covariance
        return self._build.prior_on_first_state(self.first, T_world_cam, twist, covariance)

    def _covariance_by_prior(self, t: Array) -> Array:
        """(12 n, 12 n) of states at times (n,) from the window's first state on."""
        return prior_covariance(self.first_covariance, t, self._build.qc.tolist())
