"""A fixed-lag smoother: Gauss-Newton over the latest clusters, all earlier ones in a prior."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.blas_threads import one_blas_thread
from gpvo.estimator.diagnostics import Repair, repairs_of, split_possible
from gpvo.estimator.final_states import joined
from gpvo.estimator.gaussian import IndeterminateError
from gpvo.estimator.graph_builder import SAME_TIME
from gpvo.estimator.initialization import start_deviations, start_states, velocity_ahead
from gpvo.estimator.lag_window import LagWindow, Sensor, new_times
from gpvo.estimator.state_times import Lag
from gpvo.estimator.unique_times import Deviations
from gpvo.estimator.window_optimizer import Optimum
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.states import States, later_states
from gpvo.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]
UNIQUE_INTERVAL = 0.025
"""Seconds between the states that carry those at unique times."""


class GaussNewtonSmoother:
    """Estimates the states of the latest clusters; what is older is final.

    States are at the clusters' ends and evenly between, `state_interval` or less apart. No input
    makes `update` fail: what cannot be used is left out and listed in `repairs`.

    >>> smoother = GaussNewtonSmoother(camera, NoiseConfig(), EstimatorConfig(state_interval=0.025))
    >>> smoother.update(frame, stop, measurements, None)
    >>> smoother.trajectory(0).pose(stop)
    """

    def __init__(self, camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> None:
        self.repairs: list[Repair] = []
        self._sensor = Sensor(camera, noise, config)
        self._window: LagWindow | None = None
        self._optimum: Optimum | None = None
        self._lag = Lag(config)
        self._final: list[States] = []
        self._leaving = States()
        self._knots: list[CovarianceKnots] = []
        self._final_deviations: list[Deviations] = []

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> States:
        """Take the inlier measurements that cluster number `frame`, which ended at `stop`, added.

        Without any, the prior carries the estimate on to `stop`. Returned are the states in the
        window as they are estimated now.
        """
        possible, repairs = split_possible(measurements, stop)
        self.repairs += repairs
        if self._window is None and len(possible) == 0:
            return States()
        window = self._window or self._first_window(possible.t.min(), fit)
        self._lag.advance(max(stop, window.states.t[-1]))
        last = window.states[-1:]
        interval = self._sensor.config.state_interval or UNIQUE_INTERVAL
        t = new_times(last.t[0], possible.t, self._lag.stop, interval)
        if len(t) + len(window.states) < 2:
            t = last.t + SAME_TIME
        ahead = velocity_ahead(last, stop, fit, self._sensor.noise)
        with one_blas_thread():
            if self._solve(window.extended(t, ahead), possible):
                self._let_go()
        return States() if self._window is None else self._window.states

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far, None if empty; start_ns is the absolute stamp of t = 0."""
        if self._window is None:
            return None
        states = States.concatenate([*self._final, *self._left(), self._window.states])
        now = self._window_knots(len(self._window.states) - 1)
        knots = CovarianceKnots.joined(CovarianceKnots.extended(self._knots, now))
        for deviations in self._deviations():
            states = deviations.merged(states)
        return Trajectory.of_states(states, knots, self._sensor.noise, start_ns)

    def _left(self) -> list[States]:
        """The states that left the window last, up to where it has its first state now."""
        if self._window is None or len(self._leaving) == 0:
            return []
        return [joined(self._leaving, self._window.states[:1])[:-1]]

    def settled(self, after: float) -> States:
        """Key states later than `after` that will not change any more."""
        return later_states(self._final, after)

    @property
    def stored_bytes(self) -> int:
        """Size of the final estimates and their covariances."""
        deviations = sum(d.t.nbytes + d.local.nbytes for d in self._final_deviations)
        states = sum(part.nbytes for part in self._final)
        return states + deviations + sum(part.nbytes for part in self._knots)

    def _deviations(self) -> Iterator[Deviations]:
        """Of the states at unique times, if these are asked for."""
        if self._window is not None and self._sensor.config.state_interval == 0:
            parts = [*self._final_deviations, self._window.deviations()]
            yield Deviations(
                np.concatenate([part.t for part in parts]),
                np.concatenate([part.local for part in parts]),
            )

    def _first_window(self, t: float, fit: VelocityFit | None) -> LagWindow:
        """The first state, whose pose defines the world."""
        state = start_states(t, fit, self._sensor.noise)
        return LagWindow.of_state(self._sensor, state, self._first_covariance)

    @property
    def _first_covariance(self) -> Array:
        """(12, 12) of the window's first state when it was solved last."""
        deviations = start_deviations(self._sensor.noise)
        return CovarianceKnots.last_covariance(self._knots, deviations)

    def _solve(self, window: LagWindow, new: Measurements) -> bool:
        """Take the new measurements; if that fails start anew from the window's, or from none.

        False if even that failed: then all is as it was before the cluster.
        """
        known = window.measurements
        attempts: list[Callable[[], tuple[LagWindow, list[Repair]]]] = [
            lambda: window.measured(new),
            lambda: self._restarted(window).measured(Measurements.concatenate([known, new])),
            lambda: (self._restarted(window), repairs_of(known, "indeterminate: left out")),
        ]
        for attempt in attempts:
            try:
                with np.errstate(all="ignore"):
                    extended, gated = attempt()
                    self._window, self._optimum, lost = extended.solved()
            except IndeterminateError as error:
                self.repairs.append(self._restart(window, error))
            else:
                self.repairs += gated + lost
                return True
        return False

    def _restarted(self, window: LagWindow) -> LagWindow:
        """The window's states without measurements, the first as uncertain as it was."""
        alone = LagWindow.of_state(self._sensor, window.states[:1], self._first_covariance)
        return replace(alone, states=window.states)

    def _restart(self, window: LagWindow, error: IndeterminateError) -> Repair:
        first = sum(map(len, [*self._final, *self._left()]))
        state = min(error.column // 12, len(window.states) - 1)
        reason = "indeterminate: started anew from the window's measurements"
        return Repair(f"x{first + state}", float(window.states.t[state]), None, reason)

    def _let_go(self) -> None:
        """Marginalize what is older than the window; its estimates and covariances are final."""
        if self._window is None or self._optimum is None:
            return
        t = self._window.states.t
        leaving = int(np.sum(t[:-1] < self._lag.start - SAME_TIME))
        if leaving:
            self._final += self._left()
            self._leaving = self._window.states[: leaving + 1]
            knots = self._window_knots(leaving)
            self._knots[-1:] = CovarianceKnots.extended(self._knots[-1:], knots)
            if self._sensor.config.state_interval == 0:
                start = self._window.states.t[leaving]
                self._final_deviations.append(self._window.deviations(start))
            try:
                self._window = self._window.marginalized(leaving, self._optimum)
            except IndeterminateError as error:
                self.repairs.append(self._restart(self._window, error))
                left = replace(self._window, states=self._window.states[leaving:])
                self._window = self._restarted(left)

    def _window_knots(self, count: int) -> CovarianceKnots:
        """Of the window's first states and the next one."""
        assert self._window is not None and self._optimum is not None
        solved = self._optimum.linearized
        first = int(solved.columns.state[len(solved.states) - len(self._window.states)])
        columns = np.arange(first, first + 12 * (count + 1))
        covariance = self._optimum.quadratic.covariance(columns)
        pairs = 12 * np.arange(count)[:, None] + np.arange(24)
        joint = covariance[pairs[:, :, None], pairs[:, None, :]]
        return CovarianceKnots(self._window.states.t[: count + 1], joint)
