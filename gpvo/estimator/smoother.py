"""GTSAM's incremental fixed-lag smoother, with a state at every measurement's own time."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors.checks import checked_key, checked_number, key_name
from factors.inner_factor import InnerFactor
from factors.lie import se3_inverse
from factors.stereo import Camera, as_camera
from gpvo.config import EstimatorConfig, NoiseConfig, with_drift
from gpvo.estimator.after_break import AfterBreak
from gpvo.estimator.blas_threads import one_blas_thread
from gpvo.estimator.dead_reckoning import DeadReckoning
from gpvo.estimator.diagnostics import BEFORE_WINDOW, Diagnostic, left_out, split_usable
from gpvo.estimator.final_states import FinalStates
from gpvo.estimator.gate import predicted_covariance, within_gate
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, graph_of
from gpvo.estimator.initialization import InitialState, velocity_ahead
from gpvo.estimator.lag_window import LagWindow, Leaving
from gpvo.estimator.learned_noise import LearnedNoise
from gpvo.estimator.newest_velocity import NewestVelocity
from gpvo.estimator.own_factors import OwnFactors, Waiting
from gpvo.estimator.segments import SegmentKnots
from gpvo.estimator.solving import Solver
from gpvo.estimator.state_times import SAME_TIME, Lag, key_interval, key_times
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.motion_estimate import MotionEstimate
from gpvo.trajectory.states import States
from gpvo.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]


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
        camera = as_camera(camera)
        noise = with_drift(noise or NoiseConfig(), camera.fx)
        self._build = GraphBuilder(camera, noise, self._config)
        self._initial = initial or InitialState.at_origin(self._build.noise)
        self._has_world = initial is not None
        self._learned = LearnedNoise(self._build.noise)
        self._newest = NewestVelocity(noise.motion_memory if noise.velocity_share < 1 else 0.0)
        self._lag, self._reckoning = Lag(self._config), DeadReckoning(self._config.bridge)
        self._own, self._segments = OwnFactors(), SegmentKnots()
        self._window = self._new_window()
        self._leaving: Leaving | None = None
        self._final = FinalStates(self._config.settling)
        self._after_break = AfterBreak(self._build, self._reckoning)

    def update(
        self,
        end_time: float,
        measurements: Measurements,
        velocity_estimate: VelocityFit | None = None,
    ) -> None:
        """Take the inlier measurements that a cluster added, which ended at `end_time`, seconds.

        Without any, the prior carries the estimate on to its end; see `DeadReckoning`. Those from
        before the first state that stays in the window are left out. `velocity_estimate`, if given,
        is where the new states start from.

        Raises
        ------
        ValueError
            If the end is not finite, or a column of the measurements has another type or length.
        """
        end_time = checked_number("end_time", end_time)
        usable, diagnostics = split_usable(measurements, self._window.keys.t, end_time)
        self.diagnostics += diagnostics
        with one_blas_thread():
            self._bridge(usable.t, end_time)
            last = float(self._window.keys.t[-1]) if len(self._window) else -np.inf
            ends = self._after_break.ends(usable, last, end_time)
            self._update(ends, usable, velocity_estimate)

    def _bridge(self, measured: Array, end_time: float) -> None:
        """Carry the estimate on over a break in which there was no cluster, if there was one.

        It ends with the first new measurement, at times (N,), or with the cluster.
        """
        keys = self._window.keys
        if len(keys):
            last = float(keys.t[-1])
            until = float(measured.min(initial=end_time, where=measured > last))
            steps = self._reckoning.steps(last, until)
            if len(steps):
                self._update(steps, Measurements.concatenate([]), None)

    def _update(
        self, ends: Array, usable: Measurements, velocity_estimate: VelocityFit | None
    ) -> None:
        """Go on to the ends (N,) of clusters, seconds, of which the last one was measured."""
        update = GraphUpdate()
        self.prepare()
        known = self._after_break.state(usable, self._window.keys[-1:], velocity_estimate)
        if known is None and self._reckoning.is_over(len(usable)) and not self._own.used:
            self._begin_again(update, usable, velocity_estimate)
        elif len(self._window):
            self._let_leave()
        elif len(usable):
            self._window.begin(update, usable.t.min(), velocity_estimate)
        else:
            return
        for end_time in ends.tolist():
            self._lag.advance(end_time)
            self._extend(update, usable, end_time, velocity_estimate, known)
        self._window.follow_motion(update)
        accepted = self._accepted(usable)
        self.diagnostics += self._own.add_to(update, self._window.numbered)
        self._solve(update, accepted)
        self._reckoning.measured(float(ends[-1]), self._window.keys.twist[-1], len(accepted))
        self._after_break.keep(len(accepted), self._window, self._segments)
        self._judge_newest()

    def awaits_place(self, stop: float, new: Measurements) -> bool:
        """Return whether new measurements until `stop`, seconds, are to wait for known landmarks.

        After a break these tell where the camera is, but may be found later than new ones.
        """
        return self._after_break.awaits(stop, new)

    def prepare(self) -> None:
        """Do now what the next update needs of this one's estimate; else that does it itself.

        The results are the same: an update that was prepared takes less time.
        """
        if self._leaving is None and len(self._window):
            with one_blas_thread():
                start, stop = self._lag.start, float(self._window.keys.t[-1])
                before = self._after_break.leave_before(start, stop)
                self._leaving = self._window.what_leaves(before)
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
        return self._window.numbered.values()

    def marginalCovariance(self, key: int) -> Array:
        """Return the covariance (6, 6) of X(k), perturbed on the right, or of V(k).

        Raises
        ------
        ValueError
            If it is not in the window.
        """
        keys = [key for k in self.window[: self._window.solved] for key in (X(k), V(k))]
        if checked_key("key", key) not in keys:
            raise ValueError(f"{key_name(key)} is not in the window")
        place = keys.index(key)
        own = slice(6 * place, 6 * place + 6)
        covariance = self._window.covariance()[own, own].copy()
        if place % 2:
            return covariance
        T_world_cam = self._window.keys.T_world_cam[[place // 2]]
        return covariance + self._segments.pose_covariance(T_world_cam)[0]

    @property
    def landmarks(self) -> tuple[NDArray[np.int64], Array]:
        """Identities (L,) of the landmarks in the window, and their points (L, 3) in the world."""
        return self._window.landmarks.points(self._window.numbered)

    @property
    def graph(self) -> gtsam.NonlinearFactorGraph:
        """Factors of the key states as they stand, with what was marginalised."""
        factors = self._window.factors
        return graph_of(filter(None, map(factors.at, range(factors.size()))))

    @property
    def states(self) -> States:
        """States that may still change, as estimated now: key states, and those at measured times.

        They are those in the window, and those that left it in the last `settling` seconds.
        """
        return States.concatenate([self._final.settling, self._window.states])

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
        return self._window.keys.t

    def trajectory(self, start_ns: int = 0) -> Trajectory | None:
        """Return the trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._window) == 0:
            return None
        with one_blas_thread():
            inside = self._window.states
            knots = self._window.knots.followed_by(self._window.knots_of(inside))
        states = States.concatenate([*self._final.parts, inside])
        knots, noise = self._segments.all_knots(states, knots), self._build.noise
        scale = self._newest.at(knots.t, noise.velocity_share)
        return Trajectory.of_states(states, knots, noise, scale, start_ns, not self._has_world)

    def latest(self) -> MotionEstimate | None:
        """Return the newest state, in constant time; None before the first measurement."""
        keys = self._window.keys
        if self._window.solved == 0:
            return None
        with one_blas_thread():
            covariance = self._window.covariance()[-12:, -12:].copy()
        T, first = keys.T_world_cam[-1], self._final.first or keys
        covariance[:6, :6] += self._segments.pose_covariance(T[None])[0]
        scale = np.repeat([1.0, self._newest.scale], 6)
        return MotionEstimate(
            float(keys.t[-1]),
            T.copy() if self._has_world else se3_inverse(first.T_world_cam[0]) @ T,
            keys.twist[-1].copy(),
            scale[:, None] * covariance * scale,
            np.array(self._build.noise.acceleration_psd),
            self._window.motion.latest_acceleration,
            covariance,
        )

    def final_states(self, after: float = -np.inf) -> States:
        """Return states later than `after`, seconds, that will not change any more."""
        return self._final.after(after)

    @property
    def stored_bytes(self) -> int:
        """Size of the final estimates and their covariances."""
        return self._final.nbytes + self._segments.nbytes + self._window.knots.nbytes

    def _new_window(self, first: int = 0) -> LagWindow:
        return LagWindow(self._build, self._own, self._reckoning, self._initial, first)

    def _begin_again(
        self, update: GraphUpdate, new: Measurements, velocity: VelocityFit | None
    ) -> None:
        """Begin a new segment where landmarks tell the pose, or at the last key state before."""
        window, start = self._window, float(new.t.min())
        may_be_told = start > window.keys.t[0]
        place = self._after_break.place(new, window.keys[-1:], velocity) if may_be_told else None
        before = start if place is None else start - SAME_TIME
        last = max(int(np.searchsorted(window.keys.t, before, "right")) - 1, 0)
        ends = window.states_until(last)
        states = States.concatenate([*self._final.parts, ends])
        knots = window.knots.followed_by(window.knots_of(ends))
        if place is None:
            t, first = float(ends.t[-1]), last
            self._initial = self._reckoning.state_after(ends.T_world_cam[-1])
            self._segments.begin(states, knots)
            self._final.end_segment(ends[:-1])
        else:
            t, first = start, last + 1
            self._initial = self._reckoning.state_after(place.T_world_cam)
            twist = self._initial.covariance[6:, 6:]
            self._segments.begin_apart(states, knots, t, place, twist)
            found = States(np.array([t]), place.T_world_cam[None], ends.twist[-1:])
            self._final.end_guessed(ends, self._reckoning.measured_until, found)
            self._reckoning.end(t)
        self._window, self._leaving = self._new_window(window.first + first), None
        self._lag = Lag(self._config)
        self._window.begin(update, t, velocity)

    def _judge_newest(self) -> None:
        """Compare velocities that were the newest with what is known of them now."""
        window, is_guessed = self._window, self._reckoning.in_window
        if is_guessed:
            self._newest.forget()
        elif self._newest.learns:
            self._newest.learn(window.keys[: window.solved], window.covariance())
        self._newest.end(float(window.keys.t[-1]), is_guessed)

    def _learn_noise(self) -> None:
        """Let Q_c follow the motion, and R the residuals in the window."""
        window = self._window
        solved, steady = window.keys[: window.solved], not self._reckoning.in_window
        if steady and len(solved) > 1 and self.noise.motion_memory > 0:
            covariance, linearized = window.covariance(), window.linearized()
            acceleration = window.motion.acceleration(solved.t)
            self._learned.learn_motion(solved, covariance, linearized, acceleration)
        self._learned.learn_errors(window.landmarks, window.numbered)

    def _let_leave(self) -> None:
        """Let the oldest states leave, and go on with the noise that was learned."""
        assert self._leaving is not None
        self._window.let_leave(self._leaving)
        self._leaving, self._build.noise = None, self._learned.now

    def _extend(
        self,
        update: GraphUpdate,
        measurements: Measurements,
        end_time: float,
        velocity: VelocityFit | None,
        known: States | None,
    ) -> None:
        """Add key states up to the cluster's end."""
        keys = self._window.keys
        stop = max(end_time, keys.t[-1])
        t = key_times(keys.t[-1], measurements.t, stop, self._interval(measurements))
        if len(t):
            ahead = velocity_ahead(keys, t[-1], velocity, self._build.noise)
            self._window.extend(update, keys[-1:].at(t, ahead) if known is None else known.at(t))

    def _interval(self, measurements: Measurements) -> float:
        """Longest time between two key states, seconds."""
        if self._config.state_interval > 0:
            return self._config.state_interval
        disparity = np.median(measurements.stereo[:, 2]) if len(measurements) else 1.0
        return key_interval(self._build.noise, self._build.camera, float(disparity))

    def _accepted(self, new: Measurements) -> Measurements:
        """Return the measurements of states that stay, within the gate."""
        window, landmarks = self._window, self._window.landmarks
        stays = new.t >= window.keys.t[window.leaves.count]
        self.diagnostics += left_out(new[~stays], BEFORE_WINDOW)
        new = new[stays]
        if self._config.gate == 0 or len(landmarks.measurements) == 0 or len(new) == 0:
            return new
        t, qc = window.keys.t[window.solved - 1 :], self._build.qc.tolist()
        covariance = predicted_covariance(window.covariance(), t, qc)
        known = landmarks.factor_before(new, window.numbered)
        new, beyond = within_gate(known, window.numbered, covariance, new, self._config.gate)
        self.diagnostics += beyond
        return new

    def _solve(self, update: GraphUpdate, accepted: Measurements) -> None:
        """Solve the window with new measurements, whatever happens; states that left it follow."""
        solver, leaves = Solver(self._window), self._window.leaves
        solver.solve(update, accepted)
        self._final.extend(leaves.states, self._window.keys[:1])
        self.diagnostics += solver.diagnostics
