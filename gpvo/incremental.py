"""The same factors in GTSAM's incremental fixed-lag smoother: what is old is marginalized."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.covariance_knots import CovarianceKnots
from gpvo.factor_graph import (
    SAME_TIME,
    FactorMaker,
    landmark_points,
    seen_twice,
    state_times,
)
from gpvo.initialization import start_states, velocity_ahead
from gpvo.joining import joined
from gpvo.lag import Lag
from gpvo.lag_window import new_times
from gpvo.mc_ransac import VelocityFit
from gpvo.repairs import Repair, named_landmark, repairs_of, split_possible
from gpvo.robust import RobustLoss
from gpvo.states import States, later_states
from gpvo.tracklets import Measurements
from gpvo.trajectory import Trajectory
from gpvo.window import FIXED, isam_parameters, joint_covariances, states_of

Array = NDArray[np.float64]
SOLVED_ANEW = "indeterminate: the window solved anew by QR"


@dataclass
class _Increment:
    """What one update adds to the smoother; time stamps decide when a key leaves it."""

    graph: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    stamps: dict[Any, float] = field(default_factory=dict)
    factors: list[gtsam.NonlinearFactor] = field(default_factory=list)

    def add_factors(self, factors: Iterable[gtsam.NonlinearFactor]) -> None:
        for factor in factors:
            self.graph.push_back(factor)
            self.factors.append(factor)

    def add_state(self, number: int, t: float, T_world_cam: Array, twist: Array) -> None:
        self.values.insert(X(number), gtsam.Pose3(T_world_cam))
        self.values.insert(V(number), twist)
        self.stamps[X(number)] = self.stamps[V(number)] = t


class IncrementalSmoother:
    """Estimates the states of the latest clusters incrementally.

    State k has the keys X(k), a Pose3 T_world_cam, and V(k), its body twist; landmark l is the
    Point3 L(l). A measurement that comes late, at a time before the last state, is interpolated
    between the states that are there. What is older than the lag is marginalized, and its last
    estimate is final.

    >>> smoother.add(gtsam.GPSFactor(X(smoother.window[-1]), position, noise))
    """

    def __init__(self, camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> None:
        self.repairs: list[Repair] = []
        self._make = FactorMaker(camera, noise, RobustLoss(config.loss, config.loss_scale))
        self._config = config
        self._lag = Lag(config)
        self._final: list[States] = []
        self._knots: list[CovarianceKnots] = []
        self._first, self._states, self._solved = 0, States(), 0
        self._pending = self._used = Measurements.concatenate([])
        self._own: list[gtsam.NonlinearFactor] = []
        self._new: list[gtsam.NonlinearFactor] = []
        self._leave_before = -np.inf
        # Callbacks are faster for factors that Python keeps alive, by the time of the update.
        self._factors: dict[float, list[gtsam.NonlinearFactor]] = {}
        # GTSAM's Cholesky is the faster one, but rejects states that are microseconds apart.
        self._start_smoother("CHOLESKY" if config.state_interval > 0 else "QR")

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> None:
        """Take the inlier measurements that cluster number `frame`, which ended at `stop`, added.

        Without any, the prior carries the estimate on to `stop`.
        """
        possible, repairs = split_possible(measurements, stop)
        self.repairs += repairs
        increment = _Increment()
        if len(self._states):
            self._keep_covariances()
        elif len(possible):
            self._begin(increment, possible.t.min(), fit)
        else:
            return
        self._lag.advance(stop)
        usable = self._usable(possible)
        self._extend_states(increment, possible.t, stop, fit)
        self._measure(increment, usable)
        increment.add_factors(self._new)
        self._own, self._new = self._own + self._new, []
        self._solve(increment)

    @property
    def window(self) -> range:
        """Numbers of the states in the window."""
        return range(self._first, self._first + len(self._states))

    @property
    def window_times(self) -> Array:
        """Times of the states in the window, seconds."""
        return self._states.t

    def add(self, *factors: gtsam.NonlinearFactor) -> None:
        """Add factors of your own between states in the window, such as IMU, GPS, or odometry.

        They are used from the next update on, and marginalized with the first of their states.
        """
        self._new += factors

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._states) == 0:
            return None
        states = States.concatenate([*self._final, self._states])
        knots = CovarianceKnots.joined([*self._knots, self._knots_until(np.inf)])
        return Trajectory.of_states(states, knots, self._make.noise, start_ns)

    def settled(self, after: float) -> States:
        """States later than `after` that will not change any more."""
        return later_states(self._final, after)

    def _start_smoother(self, factorization: str) -> None:
        self._smoother = gtsam.IncrementalFixedLagSmoother(np.inf, isam_parameters(factorization))
        # While Python holds it, GTSAM does not copy all values for each factor written in Python.
        self._linearization_point = self._smoother.getLinearizationPoint()
        self._active = gtsam.Values()

    def _begin(self, increment: _Increment, t: float, fit: VelocityFit | None) -> None:
        """The first state, whose pose defines the world."""
        self._states = start_states(t, fit, self._make.noise)
        pose, twist = self._states.T_world_cam[0], self._states.twist[0]
        increment.add_state(0, t, pose, twist)
        increment.add_factors(self._make.anchor(0, pose, twist, self._anchor_covariance()))

    def _keep_covariances(self) -> None:
        """Of the states that leave with the next update, which the latest cluster made old."""
        self._leave_before = min(self._lag.start, self._states.t[-1])
        knots = self._knots_until(self._leave_before)
        if len(knots.t):
            self._knots.append(knots)

    def _anchor_covariance(self) -> Array:
        """(12, 12) of the window's first state."""
        if self._knots:
            return self._knots[-1].joint[-1, 12:, 12:]
        deviations = np.repeat([FIXED, self._make.noise.initial_velocity], 6)
        return np.diag(deviations**2)

    def _usable(self, measurements: Measurements) -> Measurements:
        """Measurements within the window, of landmarks that are known or measured twice."""
        known = Measurements.concatenate([self._pending, measurements])
        known = known[known.t >= self._states.t[0]]
        ready = np.isin(known.landmark, seen_twice(known).landmark)
        ready |= np.array([self._active.exists(L(number)) for number in known.landmark], bool)
        self._pending = known[~ready]
        used = Measurements.concatenate([self._used, known[ready]])
        self._used = used[used.t >= self._states.t[0]]
        return known[ready]

    def _extend_states(
        self, increment: _Increment, measured: Array, stop: float, fit: VelocityFit | None
    ) -> None:
        """States at the measured or the key times, or at the cluster's end if there are none."""
        t_last, interval = self._states.t[-1], self._config.state_interval
        t = state_times(measured, 0.0, t_last)
        if interval > 0:
            t = new_times(t_last, measured, max(stop, t_last), interval)
        elif len(t) == 0:
            t = state_times(np.array([stop]), 0.0, t_last)
        if len(t) == 0:
            return
        ahead = velocity_ahead(self._states, t[-1], fit, self._make.noise)
        new, last = self._states.at(t, ahead), len(self._states) - 1
        for number, state in enumerate(zip(new.t, new.T_world_cam, new.twist, strict=True)):
            increment.add_state(self._first + last + 1 + number, *state)
        self._states = States.concatenate([self._states, new])
        increment.add_factors(self._make.motion(self.window[last:], self._states.t[last:]))

    def _measure(self, increment: _Increment, measurements: Measurements) -> None:
        """Reprojection factors, new landmarks, and the lag of all that are seen from now on."""
        T_world_cam, _ = self._states.query(measurements.t)
        for landmark, point in landmark_points(measurements, T_world_cam, self._make.camera):
            increment.stamps[L(landmark)] = self._states.t[-1]
            if not self._active.exists(L(landmark)):
                increment.values.insert(L(landmark), point)
        factors = self._make.reprojection(self.window, self._states.t, measurements)
        increment.add_factors(factors)

    def _solve(self, increment: _Increment) -> None:
        """Update the smoother; if that fails make it anew, by QR, without what is to blame.

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
        while failure is not None and len(self._used):
            lost = named_landmark(failure, self._used)
            self.repairs += repairs_of(lost, "indeterminate: left out, the window solved anew")
            self._used = self._used[~np.isin(self._used.landmark, lost.landmark)]
            failure = self._failure(self._window_anew())
        if failure is not None:
            self._states = self._states[:1].at(self._states.t)
            self._update(self._window_anew())

    def _failure(self, increment: _Increment) -> Exception | None:
        """Update the smoother; what went wrong if that fails."""
        try:
            self._update(increment)
        except (RuntimeError, IndexError, ValueError) as error:
            return error
        return None

    def _update(self, increment: _Increment) -> None:
        """Update the smoother, and take over its estimate of the states in the window."""
        newest = float(self._states.t[-1])
        active = {t: kept for t, kept in self._factors.items() if t >= self._leave_before}
        self._factors = active | {newest: active.get(newest, []) + increment.factors}
        self._smoother.setSmootherLag(newest - self._leave_before + SAME_TIME)
        self._smoother.update(increment.graph, increment.values, increment.stamps)
        estimate = self._smoother.calculateEstimate()
        left = next(n for n, k in enumerate(self.window) if estimate.exists(X(k)))
        states = states_of(estimate, self.window[left:], self._states.t[left:])
        self._check_landmarks(estimate, states)
        self._active = estimate
        self._let_go(left, states)

    def _let_go(self, count: int, newest: States) -> None:
        """The first states are final; the others are now where the newest estimate has them."""
        if count:
            self._final.append(joined(self._states[: count + 1], newest[:1])[:-1])
        self._first += count
        self._states, self._solved = newest, len(newest)
        inside = {key(k) for k in self.window for key in (X, V)}
        self._own = [factor for factor in self._own if inside.issuperset(factor.keys())]

    def _window_anew(self) -> _Increment:
        """Everything in the window, for a smoother that knows nothing yet."""
        old = int(np.sum(self._states.t < self._leave_before - SAME_TIME))
        self._let_go(old, self._states[old:])
        self._start_smoother("QR")
        increment, states = _Increment(), self._states
        start = states.T_world_cam[0], states.twist[0]
        anchor = self._make.anchor(self._first, *start, self._anchor_covariance())
        increment.add_factors([*anchor, *self._make.motion(self.window, states.t), *self._own])
        for k, t, T_world_cam, twist in zip(
            self.window, states.t, states.T_world_cam, states.twist, strict=True
        ):
            increment.add_state(k, t, T_world_cam, twist)
        self._used = self._used[self._used.t >= states.t[0]]
        self._measure(increment, self._used)
        return increment

    def _check_landmarks(self, estimate: gtsam.Values, states: States) -> None:
        """RuntimeError that names a landmark that is behind the camera where it was measured."""
        used = self._used[self._used.t >= states.t[0]]
        numbers, which = np.unique(used.landmark, return_inverse=True)
        points = np.array([estimate.atPoint3(L(number)) for number in numbers.tolist()])
        T_world_cam, _ = states.query(used.t)
        rays = points.reshape(-1, 3)[which] - T_world_cam[:, :3, 3]
        behind = ~(np.einsum("ni,ni->n", rays, T_world_cam[:, :3, 2]) > 0)
        if behind.any():
            raise RuntimeError(f"landmark l{used.landmark[behind][0]} is behind the camera")

    def _knots_until(self, stop: float) -> CovarianceKnots:
        """The next knots, as long as the one before them is older than `stop`."""
        start = self._knots[-1].t[-1] if self._knots else self._states.t[0]
        solved = self._states.t[: self._solved]
        later = state_times(solved[solved > start], self._config.covariance_interval, start)
        times = np.append(start, later)
        times = times[: 1 + int(np.sum(times[:-1] < stop - SAME_TIME))]
        numbers = self._first + np.searchsorted(self._states.t, times)
        joint = joint_covariances(self._smoother.getISAM2(), numbers.tolist())
        return CovarianceKnots(times, joint) if len(joint) else CovarianceKnots()
