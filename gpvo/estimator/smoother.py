"""GTSAM's incremental fixed-lag smoother, with a state at every measurement's own time."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import StatesBetween
from factors.checks import checked_key, key_name
from factors.inner_factor import InnerFactor
from factors.lie import se3_inverse
from factors.stereo import Camera, as_camera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.blas_threads import one_blas_thread
from gpvo.estimator.dead_reckoning import ENOUGH, DeadReckoning
from gpvo.estimator.diagnostics import Diagnostic, split_usable
from gpvo.estimator.final_states import correct_final_states
from gpvo.estimator.gate import predicted_covariance, within_gate
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.initialization import InitialState, start_states, velocity_ahead
from gpvo.estimator.isam2 import (
    FAILURES,
    KeyStateSmoother,
    are_covariances,
    pairs_of_neighbours,
    prior_covariance,
)
from gpvo.estimator.known_place import KnownPlace, PoseInWorld
from gpvo.estimator.learned_noise import LearnedNoise
from gpvo.estimator.own_factors import LEFT_OUT as OWN_LEFT_OUT
from gpvo.estimator.own_factors import OwnFactors, Waiting, factors_that_leave
from gpvo.estimator.segments import Segments
from gpvo.estimator.state_times import SAME_TIME, Lag, key_interval, key_times
from gpvo.estimator.window_knots import WindowKnots, joint_covariances
from gpvo.estimator.window_landmarks import WindowLandmarks, merged_states
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.motion_estimate import MotionEstimate
from gpvo.trajectory.states import States, later_states
from gpvo.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]
SOLVED_AGAIN = "indeterminate: the window was solved again"
GUESSED_STEPS = 4
"""More Gauss-Newton steps of an update where some of the motion is guessed, and may be far off."""
LEFT_OUT = "indeterminate: all measurements in the window were left out"


@dataclass(frozen=True, eq=False)
class Leaving:
    """States that the next update marginalises: `count` key states, those before a time, seconds.

    With the states between, and their covariance knots.
    """

    before: float
    count: int
    states: States
    knots: CovarianceKnots


class FixedLagSmoother:
    """Estimates the states of the latest clusters by gtsam.IncrementalFixedLagSmoother.

    GTSAM's variables are key states: X(k), a Pose3 T_world_cam, and V(k), its body twist, at the
    clusters' ends, and between these where the prior is loose. The states at the measurements' own
    times and the landmarks are eliminated exactly in one factor of the key states, and the former
    are given back. What is older than the lag is marginalised, and its last estimate is final. No
    input makes `update` fail: what cannot be used is left out and listed in `diagnostics`.

    >>> smoother = FixedLagSmoother(camera, NoiseConfig(), EstimatorConfig())
    >>> smoother.update(end_time, measurements)
    >>> smoother.add(gtsam.GPSFactor(X(smoother.window[-1]), position, noise))
    >>> smoother.add(gtsam.GPSFactor(0, position, noise), t=0.123)

    Parameters
    ----------
    camera
        Intrinsics of the rectified pair; or gtsam.Cal3_S2Stereo.
    noise, config
        By default those of the paper, and a window of clusters' ends.
    initial
        State at the first measurement, in a world of your own: that of GPS, say. By default the
        world is the first pose.
    """

    def __init__(
        self,
        camera: Camera,
        noise: NoiseConfig | None = None,
        config: EstimatorConfig | None = None,
        initial: InitialState | None = None,
    ) -> None:
        self.diagnostics: list[Diagnostic] = []
        self._config = config or EstimatorConfig()
        self._build = GraphBuilder(as_camera(camera), noise or NoiseConfig(), self._config)
        self._initial = initial or InitialState.at_origin(self._build.noise)
        self._has_world = initial is not None
        self._learned = LearnedNoise(self._build.noise)
        self._lag, self._reckoning = Lag(self._config), DeadReckoning(self._config.bridge)
        self._landmarks = WindowLandmarks(self._build)
        self._own = OwnFactors()
        self._final: list[States] = []
        self._knots = WindowKnots(self._config.covariance_interval)
        self._segments = Segments()
        self._place: KnownPlace | None = None
        self._first, self._keys = 0, States()
        self._between: StatesBetween | None = None
        self._solved = 0
        self._leave_before, self._leaving, self._old = -np.inf, 0, States()
        self._next: Leaving | None = None
        self._smoother = KeyStateSmoother()

    def update(
        self,
        end_time: float,
        measurements: Measurements,
        velocity_estimate: VelocityFit | None = None,
    ) -> None:
        """Take the inlier measurements that a cluster added, which ended at `end_time`, seconds.

        Without any, the prior carries the estimate on to its end; see `DeadReckoning`.
        `velocity_estimate`, if given, is where the new states start from.

        Raises
        ------
        ValueError
            If a column of the measurements has another type or length.
        """
        usable, left_out = split_usable(measurements, self._keys.t, end_time)
        self.diagnostics += left_out
        update = GraphUpdate()
        with one_blas_thread():
            self.prepare()
            if self._reckoning.is_over(len(usable)) and not self._own.used:
                self._begin_again(update, usable, velocity_estimate)
            elif len(self._keys):
                self._keep_what_leaves()
            elif len(usable):
                self._begin(update, usable.t.min(), velocity_estimate)
            else:
                return
            self._lag.advance(end_time)
            self._extend(update, usable, end_time, velocity_estimate)
            accepted = self._accepted(usable)
            self.diagnostics += self._own.add_to(update, self._window)
            self._solve(update, accepted)
            self._reckoning.measured(end_time, self._keys.twist[-1], len(accepted))
            self._keep_place(len(accepted))

    def prepare(self) -> None:
        """Do now what the next update needs of this one's estimate; else that does it itself.

        The results are the same: an update that was prepared takes less time.
        """
        if self._next is None and len(self._keys):
            with one_blas_thread():
                self._next = self._what_leaves()
                self._learn_noise()

    def add(
        self, *factors: InnerFactor, t: float | None = None, velocity: int | None = None
    ) -> None:
        """Add factors of your own, such as IMU, GPS, or odometry.

        Without t they are of key states in the window, and used from the next update on. With a
        time t, seconds, they are of the pose at t, which their first key stands for, and of the
        body twist if `velocity` is their key that stands for it: see `factors.InterpolatedFactor`.
        They then wait until the window reaches t. They are marginalised with the first of their
        states. One that fails, or has a state or a time that is not in the window, is left out and
        listed in `diagnostics`.
        """
        self._own.new += [Waiting(factor, t, velocity) for factor in factors]

    def calculateEstimate(self) -> gtsam.Values:
        """Return the key states X(k), V(k) in the window as estimated now."""
        return self._window.values()

    def marginalCovariance(self, key: int) -> Array:
        """Return the covariance (6, 6) of X(k), perturbed on the right, or of V(k).

        Raises
        ------
        ValueError
            If it is not in the window.
        """
        keys = [key for k in self.window[: self._solved] for key in (X(k), V(k))]
        if checked_key("key", key) not in keys:
            raise ValueError(f"{key_name(key)} is not in the window")
        place = keys.index(key)
        own = slice(6 * place, 6 * place + 6)
        covariance = self._covariance()[own, own].copy()
        if place % 2:
            return covariance
        return covariance + self._segments.pose_covariance(self._keys.T_world_cam[[place // 2]])[0]

    @property
    def landmarks(self) -> tuple[NDArray[np.int64], Array]:
        """Identities (L,) of the landmarks in the window, and their points (L, 3) in the world."""
        return self._landmarks.points(self._window)

    @property
    def graph(self) -> gtsam.NonlinearFactorGraph:
        """Factors of the key states as they stand, with what was marginalised."""
        found, factors = gtsam.NonlinearFactorGraph(), self._smoother.factors
        for factor in map(factors.at, range(factors.size())):
            if factor is not None:
                found.push_back(factor)
        return found

    @property
    def states(self) -> States:
        """States in the window as estimated now: key states, and those at the measured times."""
        return self._states_until(len(self._keys) - 1)

    @property
    def noise(self) -> NoiseConfig:
        """Noise of motion and measurements as it is used now."""
        return self._build.noise

    @property
    def window(self) -> range:
        """Numbers k of the key states X(k), V(k) in the window."""
        return self._window.numbers

    @property
    def window_times(self) -> Array:
        """Times of the key states in the window, seconds."""
        return self._keys.t

    def trajectory(self, start_ns: int = 0) -> Trajectory | None:
        """Return the trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._keys) == 0:
            return None
        with one_blas_thread():
            inside = self.states
            knots = self._knots.followed_by(self._knots_of(inside))
        states = States.concatenate([*self._final, inside])
        knots = self._segments.all_knots(states, knots)
        from_first = not self._has_world
        return Trajectory.of_states(states, knots, self._build.noise, start_ns, from_first)

    def latest(self) -> MotionEstimate | None:
        """Return the newest state, in constant time; None before the first measurement."""
        if self._solved == 0:
            return None
        with one_blas_thread():
            covariance = self._covariance()[-12:, -12:].copy()
        T, first = self._keys.T_world_cam[-1], self._final[0] if self._final else self._keys
        covariance[:6, :6] += self._segments.pose_covariance(T[None])[0]
        return MotionEstimate(
            float(self._keys.t[-1]),
            T if self._has_world else se3_inverse(first.T_world_cam[0]) @ T,
            self._keys.twist[-1],
            covariance,
            np.array(self._build.noise.acceleration_psd),
        )

    def final_states(self, after: float = -np.inf) -> States:
        """Return states later than `after`, seconds, that will not change any more."""
        return later_states(self._final, after)

    @property
    def stored_bytes(self) -> int:
        """Size of the final estimates and their covariances."""
        states = sum(part.nbytes for part in self._final)
        return states + self._segments.nbytes + self._knots.nbytes

    @property
    def _window(self) -> NumberedStates:
        return NumberedStates(self._first, self._keys)

    def _begin(self, update: GraphUpdate, t: float, velocity: VelocityFit | None) -> None:
        """Make the first state."""
        self._keys = start_states(t, velocity, self._initial)
        update.add_states(self._window)
        update.add_factors(self._prior_on_first_state())

    def _begin_again(
        self, update: GraphUpdate, new: Measurements, velocity: VelocityFit | None
    ) -> None:
        """Begin a new segment where landmarks tell the pose, or at the last key state before."""
        last = max(int(np.searchsorted(self._keys.t, new.t.min(), "right")) - 1, 0)
        ends = self._states_until(last)
        states = States.concatenate([*self._final, ends])
        knots = self._knots.followed_by(self._knots_of(ends))
        place = self._place_again(new, velocity) if new.t.min() > ends.t[-1] else None
        if place is None:
            t, first, known = float(ends.t[-1]), last, ends[:-1]
            self._initial = self._reckoning.state_after(ends.T_world_cam[-1])
            self._segments.begin(states, knots)
        else:
            t, first, known = float(new.t.min()), last + 1, ends
            self._initial = self._reckoning.state_after(place.T_world_cam)
            twist = self._initial.covariance[6:, 6:]
            self._segments.begin_apart(states, knots, t, place, twist)
            self._reckoning.end(t)
        self._final += [known] if len(known) else []
        self._forget_window(self._first + first)
        self._begin(update, t, velocity)

    def _forget_window(self, first: int) -> None:
        """Forget all that is estimated; the next state gets the number `first`."""
        self._knots = WindowKnots(self._config.covariance_interval)
        self._leave_before, self._leaving, self._next = -np.inf, 0, None
        self._first, self._between, self._solved = first, None, 0
        self._lag, self._landmarks = Lag(self._config), WindowLandmarks(self._build)
        self._smoother = KeyStateSmoother()

    def _keep_place(self, count: int) -> None:
        """Keep the landmarks as they are known when their measurements cease."""
        if count >= ENOUGH:
            self._place = None
        elif self._place is None and self._config.lost_landmarks:
            T = self._keys.T_world_cam[:1]
            covariance = self._first_covariance[:6, :6] + self._segments.pose_covariance(T)[0]
            self._place = KnownPlace(*self.landmarks, PoseInWorld(T[0], covariance))

    def _place_again(self, new: Measurements, velocity: VelocityFit | None) -> PoseInWorld | None:
        """Find the pose at the first measurement by landmarks that were known before."""
        if self._place is None or velocity is None:
            return None
        noise = self._build.noise
        variance = noise.known_again**2 + 1 / np.array(noise.measurement_information)
        return self._place.pose(self._build.camera, new, velocity, variance)

    def _prior_on_first_state(self) -> list[gtsam.NonlinearFactor]:
        T_world_cam, twist = self._keys.T_world_cam[0], self._keys.twist[0]
        covariance = self._first_covariance
        return self._build.prior_on_first_state(self._first, T_world_cam, twist, covariance)

    @property
    def _first_covariance(self) -> Array:
        """(12, 12) of the window's first state when it was solved last."""
        known = self._knots.last_covariance
        return self._initial.covariance if known is None else known

    def _learn_noise(self) -> None:
        """Let Q_c follow the motion, and R the residuals in the window."""
        solved, numbers = self._keys[: self._solved], self.window[: self._solved]
        steady = self._solved > 1 and not self._reckoning.in_window
        if steady and self._learned.now.motion_memory > 0:
            linearized = self._smoother.linearized(numbers, solved.t)
            self._learned.learn_motion(solved, self._covariance(), linearized)
        if self._landmarks.factor is not None:
            self._learned.learn_errors(self._landmarks.factor, self._window)

    def _what_leaves(self) -> Leaving:
        """Return the states that the latest cluster made old."""
        before = min(self._lag.start, self._keys.t[-1])
        count = self._window.before(before - SAME_TIME)
        states = self._states_until(count)
        return Leaving(before, count, states, self._knots_of(states))

    def _keep_what_leaves(self) -> None:
        """Keep the states that leave, and go on with the noise that was learned."""
        assert self._next is not None
        leaves, self._next = self._next, None
        self._leave_before, self._leaving, self._old = leaves.before, leaves.count, leaves.states
        self._knots.extend(leaves.knots)
        self._build.noise = self._learned.now

    def _extend(
        self,
        update: GraphUpdate,
        measurements: Measurements,
        end_time: float,
        velocity: VelocityFit | None,
    ) -> None:
        """Add key states up to the cluster's end, and the WNOA priors between them."""
        last, count = self._keys.t[-1], len(self._keys)
        t = key_times(last, measurements.t, max(end_time, last), self._interval(measurements))
        if len(t) == 0:
            return
        ahead = velocity_ahead(self._keys, t[-1], velocity, self._build.noise)
        new = self._keys[-1:].at(t, ahead)
        self._keys = States.concatenate([self._keys, new])
        update.add_states(self._window.after(count))
        self._reckoning.extend(float(last), float(t[-1]))
        update.add_factors(self._motion_since(count - 1))

    def _motion_since(self, first: int) -> list[gtsam.NonlinearFactor]:
        """Make the WNOA priors from a key state on, and what is guessed of the velocity."""
        numbers, t = self.window[first:], self._keys.t[first:]
        density = self._reckoning.densities(t, self._build.qc)
        return [*self._build.motion(numbers, t, density), *self._reckoning.at_rest(numbers, t)]

    def _interval(self, measurements: Measurements) -> float:
        """Longest time between two key states, seconds."""
        if self._config.state_interval > 0:
            return self._config.state_interval
        disparity = np.median(measurements.stereo[:, 2]) if len(measurements) else 1.0
        return key_interval(self._build.noise, self._build.camera, float(disparity))

    def _accepted(self, new: Measurements) -> Measurements:
        """Return the measurements within the gate."""
        if self._config.gate == 0 or len(self._landmarks.measurements) == 0 or len(new) == 0:
            return new
        t, qc = self._keys.t[self._solved - 1 :], self._build.qc.tolist()
        covariance = predicted_covariance(self._covariance(), t, qc)
        known = self._landmarks.factor_of(self._window)
        new, left_out = within_gate(known, self._window, covariance, new, self._config.gate)
        self.diagnostics += left_out
        return new

    def _solve(self, update: GraphUpdate, accepted: Measurements) -> None:
        """Update the smoother with new measurements; if that fails make it again."""
        failure = self._add_measurements(update, accepted) or self._failure(update)
        if failure is not None:
            self._report(f"{SOLVED_AGAIN} ({failure})")
            self._solve_again()

    def _add_measurements(self, update: GraphUpdate, new: Measurements) -> Exception | None:
        """Add new measurements, marginalise those that leave; return what went wrong if it does."""
        leaving, in_graph = self._leaving, self._smoother.factors
        others = factors_that_leave(in_graph, update, self._window, leaving, self._landmarks.index)
        try:
            self._landmarks.add_to(update, self._window, new, leaving, others)
        except self._failures as error:
            return error
        return None

    def _solve_again(self) -> None:
        """Make a smoother of the window: as it is, then without own factors, then without all."""
        self.diagnostics += self._own.drop_failing(self._window)
        if self._failure(self._window_again()) is None:
            return
        if self._own.active:
            if self._without_one_own_factor():
                return
            self._report("indeterminate: factors of your own were left out")
            self._own.active.clear()
            if self._failure(self._window_again()) is None:
                return
        if self._failure(self._window_again(forget=True)) is None:
            return
        self._report(LEFT_OUT)
        self._landmarks.clear()
        self._keys = self._keys[:1].at(self._keys.t)
        if self._failure(self._window_again()) is not None:
            self._between, self._solved = None, len(self._keys)

    def _without_one_own_factor(self) -> bool:
        """Leave out the one factor of a user's own, if any, without which the window is solved."""
        for factor in reversed(tuple(self._own.active)):
            place = self._own.active.index(factor)
            self._own.active.pop(place)
            if self._failure(self._window_again()) is None:
                key, t = key_name(factor.keys()[0]), float(self._keys.t[-1])
                self.diagnostics.append(Diagnostic(key, t, None, f"{OWN_LEFT_OUT}: indeterminate"))
                return True
            self._own.active.insert(place, factor)
        return False

    def _report(self, reason: str) -> None:
        key = key_name(X(self._first))
        self.diagnostics.append(Diagnostic(key, float(self._keys.t[0]), None, reason))

    def _failure(self, update: GraphUpdate) -> Exception | None:
        """Update the smoother; return what went wrong if that fails."""
        try:
            self._update(update)
        except self._failures as error:
            return error
        return None

    @property
    def _failures(self) -> tuple[type[Exception], ...]:
        """What an update may raise; a factor of a user's own raises what it likes."""
        return (Exception,) if self._own.active else FAILURES

    def _update(self, update: GraphUpdate) -> None:
        """Update the smoother, and take over its estimate of the states in the window."""
        more_steps = GUESSED_STEPS if self._reckoning.in_window else 0
        times = float(self._keys.t[-1]), self._leave_before
        self._landmarks.updated(self._smoother.update(update, *times, more_steps))
        left = self._leaving
        self._let_go(self._smoother.states(self.window[left:], self._keys.t[left:]))

    def _let_go(self, newest: States) -> None:
        """Make the states that leave final, and move on the others."""
        if self._leaving:
            self._final.append(correct_final_states(self._old, newest[:1])[:-1])
        self._leave(newest)
        self._solved = len(newest)
        self._between = self._landmarks.states_between(self._window)

    def _leave(self, stays: States) -> None:
        """Begin the window at the first key state that stays."""
        self._first, self._keys, self._leaving = self._first + self._leaving, stays, 0
        self._own.keep({key(k) for k in self.window for key in (X, V)})
        self._reckoning.forget(float(stays.t[0]))

    def _states_until(self, last: int) -> States:
        """Return the states in the window up to the key state number `last`."""
        measured = self._landmarks.measurements.t if self._build.unique_times else np.empty(0)
        return merged_states(self._keys[: last + 1], self._between, measured)

    def _window_again(self, forget: bool = False) -> GraphUpdate:
        """Return everything in the window, for a new smoother."""
        leaving = self._leaving
        if leaving:
            self._final.append(self._old[:-1])
            self._leave(self._keys[leaving:])
        self._smoother, update = KeyStateSmoother(), GraphUpdate()
        motion = self._motion_since(0)
        update.add_factors([*self._prior_on_first_state(), *motion, *self._own.active])
        update.add_states(self._window)
        # A prior is of the first state; with another one it says nothing.
        self._landmarks.add_all_to(update, self._window, forget or leaving > 0)
        return update

    def _knots_of(self, states: States) -> CovarianceKnots:
        """Return the next knots, of the first states in the window, the last one a key state."""
        t_keys = self._keys.t[self._keys.t <= states.t[-1]]
        t = self._knots.next_times(t_keys if self._between is None else states.t, t_keys)
        if len(t) < 2:
            return CovarianceKnots()
        joint = joint_covariances(t, self._keys.t, self._covariance(), self._between)
        if are_covariances(joint):
            return CovarianceKnots(t, joint)
        return CovarianceKnots(t, pairs_of_neighbours(self._covariance_by_prior(t)))

    def _covariance(self) -> Array:
        """(12 K, 12 K) of the key states that were solved; the prior's alone if GTSAM has none."""
        found = self._smoother.covariance(self.window[: self._solved])
        return self._covariance_by_prior(self._keys.t[: self._solved]) if found is None else found

    def _covariance_by_prior(self, t: Array) -> Array:
        """(12 n, 12 n) of states at times (n,) from the window's first state on."""
        return prior_covariance(self._first_covariance, t, self._build.qc.tolist())
