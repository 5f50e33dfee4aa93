"""The same factors in GTSAM's incremental fixed-lag smoother: what is old is marginalized."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.covariance_knots import CovarianceKnots
from gpvo.factor_graph import FactorMaker, landmark_points, seen_twice, state_times
from gpvo.initialization import start_states, velocity_ahead
from gpvo.mc_ransac import VelocityFit
from gpvo.states import States
from gpvo.tracklets import Measurements
from gpvo.trajectory import Trajectory
from gpvo.window import FIXED, joint_covariance, qr_parameters

Array = NDArray[np.float64]


class FixedLagSmoother:
    """Estimates the states of the latest clusters incrementally.

    New states are those of the newest measurements; a measurement that comes late, at a time before
    the last state, is interpolated between the states that are there. What is older than the window
    is marginalized, and its last estimate is final.
    """

    def __init__(self, camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> None:
        self._make = FactorMaker(camera, noise)
        self._config = config
        self._smoother = gtsam.IncrementalFixedLagSmoother(np.inf, qr_parameters())
        self._active = gtsam.Values()
        self._states = States()
        self._first_active = self._solved = 0
        self._cluster_ends: deque[float] = deque(maxlen=config.window)
        self._pending = Measurements.concatenate([])
        self._knots = CovarianceKnots()
        self._factors: deque[list[gtsam.NonlinearFactor]] = deque(maxlen=2 * config.window)

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> None:
        """Take the inlier measurements that cluster number `frame`, which ended at `stop`, added.

        Without any, the prior carries the estimate on to `stop`.
        """
        self._cluster_ends.append(stop)
        graph, values, stamps = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
        if len(self._states) == 0:
            if len(measurements) == 0:
                return
            self._states = start_states(measurements.t.min(), fit, self._make.noise)
            self._insert_states(values, stamps, 0)
            anchor = np.repeat([FIXED, self._make.noise.initial_velocity], 6) ** 2
            first = self._states.T_world_cam[0], self._states.twist[0]
            self._add(graph, self._make.anchor(0, *first, np.diag(anchor)))

        usable = self._usable(measurements)
        last = len(self._states) - 1
        self._extend_states(usable, stop, fit)
        self._insert_states(values, stamps, last + 1)
        self._insert_landmarks(values, stamps, usable)
        numbers = range(self._first_active, len(self._states))
        t = self._states.t[self._first_active :]
        self._add(graph, self._make.motion(range(last, len(self._states)), self._states.t[last:]))
        self._add(graph, self._make.reprojection(numbers, t, usable))
        self._solve(graph, values, stamps)

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._states) == 0:
            return None
        knots = self._knots_before(np.inf)
        return Trajectory.of_states(self._states, knots, self._make.noise, start_ns)

    def _usable(self, measurements: Measurements) -> Measurements:
        """Measurements within the window, of landmarks that are known or measured twice."""
        known = Measurements.concatenate([self._pending, measurements])
        known = known[known.t >= self._states.t[self._first_active]]
        twice = np.isin(known.landmark, seen_twice(known).landmark)
        ready = twice | [self._active.exists(L(landmark)) for landmark in known.landmark.tolist()]
        self._pending = known[~ready]
        return known[ready]

    def _extend_states(
        self, measurements: Measurements, stop: float, fit: VelocityFit | None
    ) -> None:
        """States at the new measurements' times, or at the cluster's end if there are none."""
        last = self._states.t[-1]
        t = state_times(measurements.t, self._config.state_interval, last)
        if len(t) == 0:
            t = state_times(np.array([stop]), 0.0, last)
        if len(t):
            ahead = velocity_ahead(self._states, t[-1], fit, self._make.noise)
            self._states.replace_from(self._states.at(t, ahead))

    def _insert_states(self, values: gtsam.Values, stamps: dict[int, float], first: int) -> None:
        states = self._states
        for k in range(first, len(states)):
            values.insert(X(k), gtsam.Pose3(states.T_world_cam[k]))
            values.insert(V(k), states.twist[k])
            stamps[X(k)] = stamps[V(k)] = states.t[k]

    def _insert_landmarks(
        self, values: gtsam.Values, stamps: dict[int, float], measurements: Measurements
    ) -> None:
        """New landmarks; all that are measured stay for the lag from now on."""
        T_world_cam, _ = self._states.query(measurements.t)
        for landmark, point in landmark_points(measurements, T_world_cam, self._make.camera):
            stamps[L(landmark)] = self._states.t[-1]
            if not self._active.exists(L(landmark)):
                values.insert(L(landmark), point)

    def _add(self, graph: gtsam.NonlinearFactorGraph, factors: list[gtsam.NonlinearFactor]) -> None:
        """Add factors; Python keeps them too, which makes their callbacks faster."""
        self._factors.append(factors)
        for factor in factors:
            graph.push_back(factor)

    def _solve(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, stamps: dict[int, float]
    ) -> None:
        """Update the smoother, and take over its estimate of the states in the window."""
        lag = self._states.t[-1] - self._cluster_ends[0]
        if len(self._cluster_ends) == self._config.window and lag > 0:
            self._knots = self._knots_before(self._cluster_ends[0])
            self._smoother.setSmootherLag(lag)
        self._smoother.update(graph, values, stamps)
        self._active = self._smoother.calculateEstimate()
        while not self._active.exists(X(self._first_active)):
            self._first_active += 1
        self._solved = len(self._states)
        numbers = range(self._first_active, self._solved)
        newest = States(
            self._states.t[self._first_active :],
            np.array([self._active.atPose3(X(k)).matrix() for k in numbers]),
            np.array([self._active.atVector(V(k)) for k in numbers]),
        )
        self._states.replace_from(newest)

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
        numbers = np.searchsorted(t, times).tolist()
        solved = self._smoother.getISAM2()
        joint = [joint_covariance(solved, i, j) for i, j in pairwise(numbers)]
        return self._knots.and_next(times, np.array(joint))
