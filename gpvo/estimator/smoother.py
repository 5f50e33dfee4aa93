"""GTSAM's incremental fixed-lag smoother over the factors: what is old is marginalized."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_graph import (
    are_covariances,
    isam_parameters,
    joint_covariances,
    prior_covariances,
    states_of,
)
from gpvo.estimator.diagnostics import Repair, named_landmark, repairs_of, split_possible
from gpvo.estimator.final_states import joined
from gpvo.estimator.gate import within_gate
from gpvo.estimator.graph_builder import SAME_TIME, FactorMaker, state_times
from gpvo.estimator.graph_update import Increment, Landmarks, NumberedStates
from gpvo.estimator.initialization import start_deviations, start_states, velocity_ahead
from gpvo.estimator.lag_window import Sensor, new_times
from gpvo.estimator.landmark_variables import LandmarkVariables
from gpvo.estimator.robust import RobustLoss
from gpvo.estimator.state_times import Lag
from gpvo.estimator.structureless_landmarks import EliminatedLandmarks
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.states import States, later_states
from gpvo.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]
SOLVED_ANEW = "indeterminate: the window solved anew"
FAILURES = (RuntimeError, IndexError, ValueError)
"""What GTSAM raises if a system is singular or a variable missing."""


class FixedLagSmoother:
    """Estimates the states of the latest clusters by gtsam.IncrementalFixedLagSmoother.

    State k has the keys X(k), a Pose3 T_world_cam, and V(k), its body twist; landmarks are
    eliminated, or Point3s L(l). A measurement that comes late, at a time before the last state, is
    interpolated between the states that are there. What is older than the lag is marginalized, and
    its last estimate is final. No input makes `update` fail: what cannot be used is left out and
    listed in `repairs`.

    >>> smoother = FixedLagSmoother(camera, NoiseConfig(), EstimatorConfig(state_interval=0.05))
    >>> smoother.update(frame, stop, measurements, None)
    >>> smoother.add(gtsam.GPSFactor(X(smoother.window[-1]), position, noise))
    """

    def __init__(self, camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> None:
        self.repairs: list[Repair] = []
        self._make = FactorMaker(camera, noise, RobustLoss(config.loss, config.loss_scale))
        self._config = config
        self._lag = Lag(config)
        key_times = config.state_interval > 0
        self._landmarks: Landmarks = LandmarkVariables(self._make)
        if key_times and config.landmarks == "eliminated":
            self._landmarks = EliminatedLandmarks(self._make, self._lag)
        self._final: list[States] = []
        self._knots: list[CovarianceKnots] = []
        self._first, self._states, self._solved = 0, States(), 0
        self._own: list[gtsam.NonlinearFactor] = []
        self._new: list[gtsam.NonlinearFactor] = []
        self._leave_before = -np.inf
        # Callbacks are faster for factors that Python keeps alive, by the time of the update.
        self._factors: dict[float, list[gtsam.NonlinearFactor]] = {}
        self._start_smoother()

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> States:
        """Take the inlier measurements that cluster number `frame`, which ended at `stop`, added.

        Without any, the prior carries the estimate on to `stop`. Returned are the states in the
        window as they are estimated now.
        """
        possible, repairs = split_possible(measurements, stop)
        self.repairs += repairs
        increment = Increment()
        if len(self._states):
            self._keep_covariances()
        elif len(possible):
            self._begin(increment, possible.t.min(), fit)
        else:
            return States()
        self._lag.advance(stop)
        self._extend_states(increment, possible.t, stop, fit)
        accepted = self._accepted(possible)
        self._landmarks.add_to(increment, self._window, accepted, self._leave_before)
        self._add_own(increment)
        self._solve(increment)
        return self._states

    @property
    def window(self) -> range:
        """Numbers of the states in the window."""
        return self._window.numbers

    @property
    def window_times(self) -> Array:
        """Times of the states in the window, seconds."""
        return self._states.t

    def add(self, *factors: gtsam.NonlinearFactor) -> None:
        """Add factors of your own between states in the window, such as IMU, GPS, or odometry.

        They are used from the next update on, and marginalized with the first of their states. If
        one of these is not in the window by then, the factor is left out and listed in `repairs`.
        """
        self._new += factors

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._states) == 0:
            return None
        states = States.concatenate([*self._final, self._states])
        now = self._knots_until(np.inf)
        knots = CovarianceKnots.joined(CovarianceKnots.extended(self._knots, now))
        return Trajectory.of_states(states, knots, self._make.noise, start_ns)

    def settled(self, after: float) -> States:
        """States later than `after` that will not change any more."""
        return later_states(self._final, after)

    @property
    def stored_bytes(self) -> int:
        """Size of the final estimates and their covariances."""
        states = sum(part.nbytes for part in self._final)
        return states + sum(part.nbytes for part in self._knots)

    @property
    def _window(self) -> NumberedStates:
        return NumberedStates(self._first, self._states)

    def _start_smoother(self) -> None:
        self._smoother = gtsam.IncrementalFixedLagSmoother(np.inf, isam_parameters())
        # While Python holds it, GTSAM does not copy all values for each factor written in Python.
        self._linearization_point = self._smoother.getLinearizationPoint()

    def _begin(self, increment: Increment, t: float, fit: VelocityFit | None) -> None:
        """The first state, whose pose defines the world."""
        self._states = start_states(t, fit, self._make.noise)
        increment.add_states(self._window)
        increment.add_factors(self._anchor())

    def _anchor(self) -> list[gtsam.NonlinearFactor]:
        """Priors on the window's first state."""
        T_world_cam, twist = self._states.T_world_cam[0], self._states.twist[0]
        return self._make.anchor(self._first, T_world_cam, twist, self._first_covariance)

    @property
    def _first_covariance(self) -> Array:
        """(12, 12) of the window's first state when it was solved last."""
        return CovarianceKnots.last_covariance(self._knots, start_deviations(self._make.noise))

    def _accepted(self, new: Measurements) -> Measurements:
        """Without the measurements beyond the gate."""
        sensor = Sensor(self._make.camera, self._make.noise, self._config)
        start = self._knots[-1].t[-1] if self._knots else self._states.t[0]
        states = self._states[int(np.searchsorted(self._states.t, start)) :]
        known = self._landmarks.used
        new, repairs = within_gate(sensor, states, self._first_covariance, known, new)
        self.repairs += repairs
        return new

    def _add_own(self, increment: Increment) -> None:
        """Add the factors of others; those of variables that are not in the window are left out."""
        for factor in self._new:
            keys = list(factor.keys())
            present = [
                self._linearization_point.exists(k) or increment.values.exists(k) for k in keys
            ]
            if not all(present):
                missing = gtsam.DefaultKeyFormatter(keys[present.index(False)])
                reason = "factor of others left out: not in the window"
                self.repairs.append(Repair(missing, float(self._states.t[-1]), None, reason))
            else:
                self._own.append(factor)
                increment.add_factors([factor])
        self._new = []

    def _keep_covariances(self) -> None:
        """Of the states that leave with the next update, which the latest cluster made old."""
        self._leave_before = min(self._lag.start, self._states.t[-1])
        knots = self._knots_until(self._leave_before)
        if len(knots.t):
            self._knots[-1:] = CovarianceKnots.extended(self._knots[-1:], knots)

    def _extend_states(
        self, increment: Increment, measured: Array, stop: float, fit: VelocityFit | None
    ) -> None:
        """States at the measured or the key times, or at the cluster's end if there are none."""
        t_last, interval = self._states.t[-1], self._config.state_interval
        if interval > 0:
            t = new_times(t_last, measured, max(stop, t_last), interval)
        else:
            unique = state_times(measured, 0.0, t_last)
            t = unique if len(unique) else state_times(np.array([stop]), 0.0, t_last)
        if len(t) == 0:
            return
        ahead = velocity_ahead(self._states, t[-1], fit, self._make.noise)
        new, last = self._states.at(t, ahead), len(self._states) - 1
        increment.add_states(NumberedStates(self._first + last + 1, new))
        self._states = States.concatenate([self._states, new])
        increment.add_factors(self._make.motion(self.window[last:], self._states.t[last:]))

    def _solve(self, increment: Increment) -> None:
        """Update the smoother; if that fails make it anew, without what is to blame.

        That may be factors of others, then the landmarks that GTSAM names, then all of them.
        """
        failure = self._failure(increment)
        if failure is None:
            return
        state = Repair(f"x{self._first}", float(self._states.t[0]), None, SOLVED_ANEW)
        self.repairs.append(state)
        failure = self._failure(self._window_anew())
        if failure is not None and self._own:
            self.repairs.append(replace(state, reason="indeterminate: factors of others left out"))
            self._own.clear()
            failure = self._failure(self._window_anew())
        while failure is not None and len(self._landmarks.used):
            used = self._landmarks.used
            lost = named_landmark(failure, used)
            self.repairs += repairs_of(lost, "indeterminate: left out, the window solved anew")
            self._landmarks.used = used[~np.isin(used.landmark, lost.landmark)]
            failure = self._failure(self._window_anew())
        if failure is not None:
            self._states = self._states[:1].at(self._states.t)
            self._failure(self._window_anew())

    def _failure(self, increment: Increment) -> Exception | None:
        """Update the smoother; what went wrong if that fails."""
        try:
            self._update(increment)
        except FAILURES as error:
            return error
        return None

    def _update(self, increment: Increment) -> None:
        """Update the smoother, and take over its estimate of the states in the window."""
        newest = float(self._states.t[-1])
        active = {t: kept for t, kept in self._factors.items() if t >= self._leave_before}
        self._factors = active | {newest: active.get(newest, []) + increment.factors}
        self._smoother.setSmootherLag(newest - self._leave_before + SAME_TIME)
        self._smoother.update(
            increment.graph, increment.values, increment.stamps, increment.removed
        )
        estimate = self._smoother.calculateEstimate()
        left = next(n for n, k in enumerate(self.window) if estimate.exists(X(k)))
        states = states_of(estimate, self.window[left:], self._states.t[left:])
        added = self._smoother.getISAM2Result().getNewFactorsIndices()
        self._landmarks.updated(estimate, states, added)
        self._let_go(left, states)

    def _let_go(self, count: int, newest: States) -> None:
        """The first states are final; the others are now where the newest estimate has them."""
        if count:
            self._final.append(joined(self._states[: count + 1], newest[:1])[:-1])
        self._first += count
        self._states, self._solved = newest, len(newest)
        inside = {key(k) for k in self.window for key in (X, V)}
        self._own = [factor for factor in self._own if inside.issuperset(factor.keys())]

    def _window_anew(self) -> Increment:
        """Everything in the window, for a smoother that knows nothing yet."""
        old = int(np.sum(self._states.t < self._leave_before - SAME_TIME))
        self._let_go(old, self._states[old:])
        self._start_smoother()
        increment, t = Increment(), self._states.t
        increment.add_factors([*self._anchor(), *self._make.motion(self.window, t), *self._own])
        increment.add_states(self._window)
        self._landmarks.add_all_to(increment, self._window)
        return increment

    def _knots_until(self, stop: float) -> CovarianceKnots:
        """The next knots, up to the first state that does not leave before `stop`."""
        start = self._knots[-1].t[-1] if self._knots else self._states.t[0]
        solved = self._states.t[: self._solved]
        end = solved[min(int(np.searchsorted(solved, stop - SAME_TIME)), len(solved) - 1)]
        inside = solved[(solved > start) & (solved <= end)]
        times = np.append(start, state_times(inside, self._config.covariance_interval, start))
        numbers = self._first + np.searchsorted(self._states.t, times)
        joint = self._joint_covariances(numbers)
        return CovarianceKnots(times, joint) if len(joint) else CovarianceKnots()

    def _joint_covariances(self, numbers: NDArray[np.int64]) -> Array:
        """(n - 1, 24, 24) of states of these numbers; the prior's alone if GTSAM has none."""
        try:
            joint = joint_covariances(self._smoother.getISAM2(), numbers.tolist())
        except FAILURES:
            joint = np.full((len(numbers) - 1, 24, 24), np.nan)
        if are_covariances(joint):
            return joint
        t, noise = self._states.t[numbers - self._first], self._make.noise
        return prior_covariances(self._first_covariance, t, noise.acceleration_psd)
