"""The sliding window of section III-C: Gauss-Newton over the latest clusters, again at each one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_inverse
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_graph import Window
from gpvo.estimator.dead_reckoning import DeadReckoning
from gpvo.estimator.diagnostics import (
    Diagnostic,
    diagnostics_of,
    named_landmark,
    split_usable,
)
from gpvo.estimator.gate import within_gate
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import NumberedStates
from gpvo.estimator.initialization import (
    InitialState,
    start_deviations,
    start_states,
    velocity_ahead,
)
from gpvo.estimator.isam2 import FAILURES, blocks_of_neighbours
from gpvo.estimator.state_times import Lag, state_times
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.motion_estimate import MotionEstimate
from gpvo.trajectory.smooth_motion import velocity_scale
from gpvo.trajectory.states import States, later_states
from gpvo.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]


class SlidingWindow:
    """Estimates the states of the latest clusters from their measurements.

    The window starts at the last state before its first measurement; that state's pose is fixed,
    and it and all earlier ones are final.
    """

    def __init__(
        self,
        camera: StereoCamera,
        noise: NoiseConfig | None = None,
        config: EstimatorConfig | None = None,
    ) -> None:
        self.diagnostics: list[Diagnostic] = []
        self._config = config or EstimatorConfig()
        self._build = GraphBuilder(camera, noise or NoiseConfig(), self._config)
        self._lag, self._reckoning = Lag(self._config), DeadReckoning(self._config.bridge)
        self._final: list[States] = []
        self._states = States()
        self._knots: list[CovarianceKnots] = []
        self._measurements = Measurements.concatenate([])
        self._coasting = np.empty(0)

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
        usable, left_out = split_usable(measurements, self._states.t, end_time)
        self.diagnostics += left_out
        if len(self._states) == 0:
            if len(usable) == 0:
                return
            start = usable.t.min()
            self._states = start_states(
                start, velocity_estimate, InitialState.at_origin(self._build.noise)
            )
        earlier, accepted = self._measurements, self._accepted(usable)
        self._add(end_time, accepted)
        t = self._window_times()
        if len(t) < 2:
            return
        optimized = self._optimized(t, velocity_estimate)
        final = int(np.searchsorted(self._states.t, t[0]))
        if final:
            self._knots.append(self._knots_until(t[0], earlier))
            self._final.append(self._states[:final])
            self._reckoning.forget(t[0])
        self._states = optimized
        self._reckoning.measured(end_time, optimized.twist[-1], len(accepted))

    @property
    def states(self) -> States:
        """States in the window as estimated now."""
        return self._states

    def _accepted(self, new: Measurements) -> Measurements:
        """Return the measurements within the gate: of states at knots, as far as these go."""
        known = seen_twice(self._measurements)
        if self._config.gate == 0 or len(known) == 0 or len(new) == 0:
            return new
        measured = np.concatenate([self._states.t, new.t, known.t])
        t = state_times(measured, self._config.covariance_interval, self._states.t[0])
        states = self._states.at(np.append(self._states.t[0], t))
        covariance = np.diag(self._first_deviations**2)
        window = NumberedStates(0, states)
        factor = self._build.structureless(window.numbers, states.t, known)
        try:
            spread = Window(states, known, covariance).covariance(self._build, len(states))
            new, left_out = within_gate(factor, window, spread, new, self._config.gate)
        except FAILURES:
            return new
        self.diagnostics += left_out
        return new

    def _optimized(self, t: Array, velocity_estimate: VelocityFit | None) -> States:
        """States at times t (K,); without the measurements if these do not determine them."""
        ahead = velocity_ahead(self._states, t[-1], velocity_estimate, self._build.noise)
        covariance = np.diag(self._first_deviations**2)
        known = seen_twice(self._measurements)
        window = Window(self._states.at(t, ahead), known, covariance, self._reckoning)
        while True:
            try:
                return window.optimize(self._build)
            except RuntimeError as error:
                if len(window.measurements) == 0:
                    return window.states
                lost = named_landmark(error, window.measurements)
                self.diagnostics += diagnostics_of(lost, "indeterminate: left out")
                self._measurements = self._measurements[
                    ~np.isin(self._measurements.landmark, lost.landmark)
                ]
                window = replace(window, measurements=seen_twice(self._measurements))

    def trajectory(self, start_ns: int = 0) -> Trajectory | None:
        """Return the trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._states) == 0:
            return None
        latest = self._knots_until(self._states.t[-1], self._measurements)
        knots = CovarianceKnots.joined([*self._knots, latest])
        states = States.concatenate([*self._final, self._states])
        scale = velocity_scale(knots.t, self._build.noise.velocity_share)
        return Trajectory.of_states(states, knots, self._build.noise, scale, start_ns)

    def latest(self) -> MotionEstimate | None:
        """Return the newest state, in constant time; None before the second state."""
        if len(self._states) < 2:
            return None
        knots = self._knots_until(self._states.t[-1], self._measurements)
        first = self._final[0] if self._final else self._states
        return MotionEstimate(
            float(self._states.t[-1]),
            se3_inverse(first.T_world_cam[0]) @ self._states.T_world_cam[-1],
            self._states.twist[-1].copy(),
            knots.joint[-1, 12:, 12:].copy(),
            np.array(self._build.noise.acceleration_psd),
        )

    def final_states(self, after: float = -np.inf) -> States:
        """Return states later than `after`, seconds, that will not change any more."""
        return later_states(self._final, after)

    @property
    def _first_deviations(self) -> Array:
        """(12,) of the pose, which is fixed, and of the twist, which the measurements tell."""
        return start_deviations(self._build.noise)

    def _add(self, stop: float, measurements: Measurements) -> None:
        known = Measurements.concatenate([self._measurements, measurements])
        known = known[known.t >= self._states.t[0]]
        self._measurements = known[known.t > self._lag.start]
        if np.isfinite(self._lag.stop):
            self._reckoning.extend(self._lag.stop, max(stop, self._lag.stop))
        self._lag.advance(stop)
        if len(measurements) == 0 or len(self._measurements) == 0:
            self._coasting = np.append(self._coasting, self._lag.stop)

    def _window_times(self) -> Array:
        """Times of the window's states; the first is final, the last before its measurements."""
        if len(self._measurements):
            start = self._measurements.t.min()
            self._coasting = self._coasting[self._coasting > start]
        t = np.concatenate([self._measurements.t, self._coasting])
        anchor = self._states.t[self._states.t < t.min()][-1:]
        return np.concatenate([anchor, state_times(t, self._config.state_interval, *anchor)])

    def _knots_until(self, stop: float, measurements: Measurements) -> CovarianceKnots:
        """Knots from the last known one to the state at `stop`, given the measurements around it.

        The graph has states at knots alone, and measurements between them are interpolated.
        """
        known = self._knots[-1] if self._knots else CovarianceKnots()
        start = known.t[-1] if len(known.t) else self._states.t[0]
        if stop <= start:
            return CovarianceKnots()
        interval = self._config.covariance_interval
        inner = self._states.t[self._states.t > start]
        final = np.append(state_times(inner[inner < stop - interval / 2], interval, start), stop)
        t = np.concatenate([[start], final, state_times(inner, interval, stop)])
        inside = (measurements.t >= t[0]) & (measurements.t <= t[-1])
        window = Window(
            self._states.at(t),
            seen_twice(measurements[inside]),
            self._covariance_at(known),
            self._reckoning,
        )
        covariance = window.covariance(self._build, 1 + len(final))
        return CovarianceKnots(t[: 1 + len(final)], blocks_of_neighbours(covariance))

    def _covariance_at(self, known: CovarianceKnots) -> Array:
        """(12, 12) of the last knot: what is known of its pose so far, of its twist nothing.

        The window's measurements, not the earlier ones that it shares with the last window, tell
        the twist.
        """
        covariance = np.diag(self._first_deviations**2)
        if len(known.joint):
            covariance[:6, :6] = known.joint[-1, 12:18, 12:18]
        return covariance
