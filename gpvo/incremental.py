"""The same factors in GTSAM's incremental fixed-lag smoother: what is old is marginalized."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
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
from gpvo.mc_ransac import VelocityFit
from gpvo.repairs import Repair, named_landmark, repairs_of, split_possible
from gpvo.robust import RobustLoss
from gpvo.states import States
from gpvo.tracklets import Measurements
from gpvo.trajectory import Trajectory
from gpvo.window import FIXED, joint_covariance, qr_parameters, states_of

Array = NDArray[np.float64]


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

    New states are those of the newest measurements; a measurement that comes late, at a time before
    the last state, is interpolated between the states that are there. What is older than the window
    is marginalized, and its last estimate is final.
    """

    def __init__(self, camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> None:
        self.repairs: list[Repair] = []
        self._make = FactorMaker(camera, noise, RobustLoss(config.loss, config.loss_scale))
        self._config = config
        self._smoother = gtsam.IncrementalFixedLagSmoother(np.inf, qr_parameters())
        self._active = gtsam.Values()
        self._states = States()
        self._first_active = self._solved = 0
        self._cluster_ends: deque[float] = deque(maxlen=config.window)
        self._pending = Measurements.concatenate([])
        self._used = Measurements.concatenate([])
        self._knots = CovarianceKnots()
        # Callbacks are faster for factors that Python keeps alive.
        self._factors: deque[list[gtsam.NonlinearFactor]] = deque(maxlen=2 * config.window)

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> None:
        """Take the inlier measurements that cluster number `frame`, which ended at `stop`, added.

        Without any, the prior carries the estimate on to `stop`.
        """
        self._cluster_ends.append(stop)
        possible, repairs = split_possible(measurements, stop)
        self.repairs += repairs
        increment = _Increment()
        if len(self._states) == 0:
            if len(possible) == 0:
                return
            self._start(increment, possible.t.min(), fit)
        usable = self._usable(possible)
        self._extend_states(increment, possible.t, stop, fit)
        self._measure(increment, usable)
        self._solve(increment)

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._states) == 0:
            return None
        knots = self._knots_before(np.inf)
        return Trajectory.of_states(self._states, knots, self._make.noise, start_ns)

    def settled(self, after: float) -> States:
        """States later than `after` that will not change any more."""
        return self._states[: self._first_active].after(after)

    def _start(self, increment: _Increment, t: float, fit: VelocityFit | None) -> None:
        """The first state, whose pose defines the world."""
        self._states = start_states(t, fit, self._make.noise)
        pose, twist = self._states.T_world_cam[0], self._states.twist[0]
        deviations = np.repeat([FIXED, self._make.noise.initial_velocity], 6)
        increment.add_state(0, t, pose, twist)
        increment.add_factors(self._make.anchor(0, pose, twist, np.diag(deviations**2)))

    def _usable(self, measurements: Measurements) -> Measurements:
        """Measurements within the window, of landmarks that are known or measured twice."""
        known = Measurements.concatenate([self._pending, measurements])
        known = known[known.t >= self._states.t[self._first_active]]
        ready = np.isin(known.landmark, seen_twice(known).landmark)
        ready |= np.array(
            [self._active.exists(L(index)) for index in known.landmark.tolist()], bool
        )
        self._pending = known[~ready]
        self._used = Measurements.concatenate([self._used, known[ready]])
        self._used = self._used[self._used.t >= self._states.t[self._first_active]]
        return known[ready]

    def _extend_states(
        self, increment: _Increment, measured: Array, stop: float, fit: VelocityFit | None
    ) -> None:
        """States at the measured times, or at the cluster's end if there are no new ones."""
        last = len(self._states) - 1
        t_last = self._states.t[last]
        t = state_times(measured, self._config.state_interval, t_last)
        if len(t) == 0:
            t = state_times(np.array([stop]), 0.0, t_last)
        if len(t) == 0:
            return
        ahead = velocity_ahead(self._states, t[-1], fit, self._make.noise)
        new = self._states.at(t, ahead)
        for number, state in enumerate(zip(new.t, new.T_world_cam, new.twist, strict=True)):
            increment.add_state(last + 1 + number, *state)
        self._states.replace_from(new)
        numbers = range(last, len(self._states))
        increment.add_factors(self._make.motion(numbers, self._states.t[last:]))

    def _measure(self, increment: _Increment, measurements: Measurements) -> None:
        """Reprojection factors, new landmarks, and the lag of all that are seen from now on."""
        T_world_cam, _ = self._states.query(measurements.t)
        for landmark, point in landmark_points(measurements, T_world_cam, self._make.camera):
            increment.stamps[L(landmark)] = self._states.t[-1]
            if not self._active.exists(L(landmark)):
                increment.values.insert(L(landmark), point)
        active = range(self._first_active, len(self._states))
        t = self._states.t[self._first_active :]
        increment.add_factors(self._make.reprojection(active, t, measurements))

    def _solve(self, increment: _Increment) -> None:
        """Update the smoother; if that fails, make it anew, without landmarks that GTSAM names."""
        try:
            return self._update(increment)
        except (RuntimeError, IndexError) as error:
            failure: Exception = error
        while len(self._used):
            lost = named_landmark(failure, self._used)
            self.repairs += repairs_of(lost, "indeterminate: left out, the window solved anew")
            self._used = self._used[~np.isin(self._used.landmark, lost.landmark)]
            try:
                return self._update(self._window_anew())
            except (RuntimeError, IndexError) as error:
                failure = error
        first = self._states[: self._first_active + 1]
        self._states.replace_from(first.at(self._states.t[self._first_active :]))
        self._update(self._window_anew())

    def _window_anew(self) -> _Increment:
        """Everything in the window, for a smoother that knows nothing yet."""
        self._smoother = gtsam.IncrementalFixedLagSmoother(np.inf, qr_parameters())
        self._active = gtsam.Values()
        increment, first, states = _Increment(), self._first_active, self._states
        deviations = np.repeat([FIXED, self._make.noise.initial_velocity], 6)
        covariance = np.diag(deviations**2)
        if len(self._knots.joint):
            covariance = self._knots.joint[-1, 12:, 12:]
        start = states.T_world_cam[first], states.twist[first]
        increment.add_factors(self._make.anchor(first, *start, covariance))
        for k in range(first, len(states)):
            increment.add_state(k, states.t[k], states.T_world_cam[k], states.twist[k])
        numbers = range(first, len(states))
        increment.add_factors(self._make.motion(numbers, states.t[first:]))
        self._measure(increment, self._used)
        return increment

    def _update(self, increment: _Increment) -> None:
        """Update the smoother, and take over its estimate of the states in the window."""
        self._factors.append(increment.factors)
        lag = self._states.t[-1] - self._cluster_ends[0] + SAME_TIME
        if len(self._cluster_ends) == self._config.window and lag > 0:
            self._knots = self._knots_before(self._cluster_ends[0])
            self._smoother.setSmootherLag(lag)
        self._smoother.update(increment.graph, increment.values, increment.stamps)
        estimate = self._smoother.calculateEstimate()
        first = self._first_active
        while not estimate.exists(X(first)):
            first += 1
        newest = states_of(estimate, range(first, len(self._states)), self._states.t[first:])
        self._check_landmarks(estimate, newest)
        left = joined(self._states[self._first_active : first + 1], newest[:1])[:-1]
        self._active, self._first_active, self._solved = estimate, first, len(self._states)
        self._states.replace_from(States.concatenate([left, newest]))

    def _check_landmarks(self, estimate: gtsam.Values, states: States) -> None:
        """RuntimeError that names a landmark that is behind the camera where it was measured."""
        used = self._used[self._used.t >= states.t[0]]
        T_world_cam, _ = states.query(used.t)
        for number, T in zip(used.landmark.tolist(), T_world_cam, strict=True):
            ray = estimate.atPoint3(L(number)) - T[:3, 3]
            if not ray @ T[:3, 2] > 0:
                raise RuntimeError(f"landmark l{number} is behind the camera")

    def _knots_before(self, stop: float) -> CovarianceKnots:
        """Knots so far, and the next as long as the one before them is older than `stop`."""
        t = self._states.t
        start = self._knots.t[-1] if len(self._knots.t) else t[0]
        active = t[self._first_active : self._solved]
        times = state_times(active[active > start], self._config.covariance_interval, start)
        times = np.concatenate([[start], times])
        leaving = int(np.sum(times[:-1] < stop))
        if leaving == 0:
            return self._knots
        times = times[: leaving + 1]
        solved, numbers = self._smoother.getISAM2(), np.searchsorted(t, times).tolist()
        joint = [joint_covariance(solved, i, j) for i, j in pairwise(numbers)]
        return self._knots.and_next(times, np.array(joint))
