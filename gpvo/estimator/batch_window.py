"""The sliding window of section III-C: Gauss-Newton over the latest clusters, again at each one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_graph import Window
from gpvo.estimator.diagnostics import Repair, named_landmark, repairs_of, split_possible
from gpvo.estimator.gate import within_gate
from gpvo.estimator.graph_builder import FactorMaker, state_times
from gpvo.estimator.initialization import start_deviations, start_states, velocity_ahead
from gpvo.estimator.lag_window import Sensor
from gpvo.estimator.robust import RobustLoss
from gpvo.estimator.state_times import Lag
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.states import States, later_states
from gpvo.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]


class SlidingWindow:
    """Estimates the states of the latest clusters from their measurements.

    The window starts at the last state before its first measurement; that state's pose is fixed,
    and it and all earlier ones are final.
    """

    def __init__(self, camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> None:
        self.repairs: list[Repair] = []
        self._make = FactorMaker(camera, noise, RobustLoss(config.loss, config.loss_scale))
        self._config = config
        self._lag = Lag(config)
        self._final: list[States] = []
        self._states = States()
        self._knots: list[CovarianceKnots] = []
        self._measurements = Measurements.concatenate([])
        self._coasting = np.empty(0)

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> States:
        """Take the inlier measurements that cluster number `frame`, which ended at `stop`, added.

        Without any, the prior carries the estimate on to `stop`. Returned are the states in the
        window as they are estimated now.
        """
        possible, repairs = split_possible(measurements, stop)
        self.repairs += repairs
        if len(self._states) == 0:
            if len(possible) == 0:
                return States()
            self._states = start_states(possible.t.min(), fit, self._make.noise)
        earlier = self._measurements
        self._add(stop, self._accepted(possible))
        t = self._window_times()
        if len(t) < 2:
            return self._states
        optimized = self._optimized(t, fit)
        final = int(np.searchsorted(self._states.t, t[0]))
        if final:
            self._knots.append(self._knots_until(t[0], earlier))
            self._final.append(self._states[:final])
        self._states = optimized
        return optimized

    def _accepted(self, new: Measurements) -> Measurements:
        """Without the measurements beyond the gate."""
        sensor = Sensor(self._make.camera, self._make.noise, self._config)
        covariance = np.diag(self._anchor_deviations**2)
        new, repairs = within_gate(sensor, self._states, covariance, self._measurements, new)
        self.repairs += repairs
        return new

    def _optimized(self, t: Array, fit: VelocityFit | None) -> States:
        """States at times t (K,); without the measurements if these do not determine them."""
        ahead = velocity_ahead(self._states, t[-1], fit, self._make.noise)
        anchor = np.diag(self._anchor_deviations**2)
        window = Window(self._states.at(t, ahead), seen_twice(self._measurements), anchor)
        while True:
            try:
                return window.optimize(self._make, self._config)
            except RuntimeError as error:
                if len(window.measurements) == 0:
                    return window.states
                lost = named_landmark(error, window.measurements)
                self.repairs += repairs_of(lost, "indeterminate: left out")
                self._measurements = self._measurements[
                    ~np.isin(self._measurements.landmark, lost.landmark)
                ]
                window = replace(window, measurements=seen_twice(self._measurements))

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if len(self._states) == 0:
            return None
        latest = self._knots_until(self._states.t[-1], self._measurements)
        knots = CovarianceKnots.joined([*self._knots, latest])
        states = States.concatenate([*self._final, self._states])
        return Trajectory.of_states(states, knots, self._make.noise, start_ns)

    def settled(self, after: float) -> States:
        """States later than `after` that will not change any more."""
        return later_states(self._final, after)

    @property
    def _anchor_deviations(self) -> Array:
        """(12,) of the pose, which is fixed, and of the twist, which the measurements tell."""
        return start_deviations(self._make.noise)

    def _add(self, stop: float, measurements: Measurements) -> None:
        known = Measurements.concatenate([self._measurements, measurements])
        known = known[known.t >= self._states.t[0]]
        self._measurements = known[known.t > self._lag.start]
        self._lag.advance(stop)
        if len(measurements) == 0:
            self._coasting = np.append(self._coasting, stop)

    def _window_times(self) -> Array:
        """Times of the window's states; the first is final, the last before its measurements."""
        if len(self._measurements):
            start = self._measurements.t.min()
            self._coasting = self._coasting[self._coasting > start]
        t = np.concatenate([self._measurements.t, self._coasting])
        anchor = self._states.t[self._states.t < t.min()][-1:]
        return np.concatenate([anchor, state_times(t, self._config.state_interval, *anchor)])

    def _knots_until(self, stop: float, measurements: Measurements) -> CovarianceKnots:
        known = self._knots[-1] if self._knots else CovarianceKnots()
        return _knots_after(
            known,
            stop,
            self._states,
            measurements,
            self._make,
            self._config.covariance_interval,
            self._anchor_deviations,
        )


def _knots_after(
    known: CovarianceKnots,
    stop: float,
    states: States,
    measurements: Measurements,
    make: FactorMaker,
    interval: float,
    first_deviations: Array,
) -> CovarianceKnots:
    """Knots from the last known one to the state at `stop`, given the measurements around it.

    The graph has states at knots alone, `interval` seconds apart, and measurements between them
    are interpolated. `first_deviations` (12,) are those of the trajectory's first state.
    """
    start = known.t[-1] if len(known.t) else states.t[0]
    if stop <= start:
        return CovarianceKnots()
    inner = states.t[states.t > start]
    final = np.append(state_times(inner[inner < stop - interval / 2], interval, start), stop)
    later = state_times(inner, interval, stop)
    t = np.concatenate([[start], final, later])
    inside = (measurements.t >= t[0]) & (measurements.t <= t[-1])
    window = Window(
        states.at(t),
        seen_twice(measurements[inside]),
        _start_covariance(known, first_deviations),
    )
    return CovarianceKnots(t[: 1 + len(final)], window.joint_covariances(make, len(final)))


def _start_covariance(known: CovarianceKnots, first_deviations: Array) -> Array:
    """(12, 12) of the last knot: what is known of its pose so far, of its twist nothing.

    The window's measurements, not the earlier ones that it shares with the last window, tell
    the twist.
    """
    covariance = np.diag(first_deviations**2)
    if len(known.joint):
        covariance[:6, :6] = known.joint[-1, 12:18, 12:18]
    return covariance
