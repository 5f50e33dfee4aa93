"""The window of a fixed-lag smoother: extended by a cluster, solved, marginalized.

Windows are values: each step returns a new one, so that a step that fails has changed nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from factors import StereoCamera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.diagnostics import Repair, repairs_of
from gpvo.estimator.gaussian import IndeterminateError
from gpvo.estimator.graph_builder import SAME_TIME
from gpvo.estimator.landmarks import Landmarks
from gpvo.estimator.marginal_prior import MarginalPrior
from gpvo.estimator.robust import RobustLoss
from gpvo.estimator.unique_times import Deviations
from gpvo.estimator.window_cost import Columns, Variables, WindowCost
from gpvo.estimator.window_optimizer import Optimum, minimize
from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
Index = NDArray[np.int64]
BEYOND_GATE = "beyond the gate: measurement left out"


@dataclass(frozen=True)
class Sensor:
    """What measures, how well, and how that is estimated from."""

    camera: StereoCamera
    noise: NoiseConfig
    config: EstimatorConfig


@dataclass(frozen=True, eq=False)
class LagWindow:
    """States in the window and what is known of them.

    Attributes
    ----------
    sensor
        Camera, noise and configuration.
    states
        From the first that is not final to the newest.
    landmarks
        Those that are estimated.
    measurements
        Between the states, in order of time; those of a landmark that is not estimated wait for a
        second one.
    prior
        What earlier measurements told.
    """

    sensor: Sensor
    states: States
    landmarks: Landmarks
    measurements: Measurements
    prior: MarginalPrior

    @staticmethod
    def of_state(sensor: Sensor, state: States, covariance: Array) -> LagWindow:
        """A window of one state, of which a covariance (12, 12) is known."""
        prior = MarginalPrior.of_state(state.T_world_cam[0], state.twist[0], covariance)
        return LagWindow(sensor, state, Landmarks(), Measurements.concatenate([]), prior)

    def extended(self, t: Array, twist_ahead: Array) -> LagWindow:
        """With further states at times t (K,), on from the last one at a body twist (6,)."""
        ahead = self.states.at(t, twist_ahead)
        return replace(self, states=States.concatenate([self.states, ahead]))

    def measured(self, new: Measurements) -> tuple[LagWindow, list[Repair]]:
        """With new measurements, but those before the window and those beyond the gate."""
        repairs: list[Repair] = []
        new = new[(new.t >= self.states.t[0]) & (new.t <= self.states.t[-1])]
        if self.sensor.config.gate > 0:
            inside = self.inside_gate(new)
            repairs = repairs_of(new[~inside], BEYOND_GATE)
            new = new[inside]
        known = Measurements.concatenate([self.measurements, new])
        known = known[np.argsort(known.t, kind="stable")]
        fresh = seen_twice(known)
        fresh = fresh[~self.landmarks.contains(fresh.landmark)]
        T_world_cam, _ = self.states.query(fresh.t)
        added = Landmarks.measured(fresh, T_world_cam, self.sensor.camera)
        landmarks = self.landmarks.and_others(added)
        return replace(self, landmarks=landmarks, measurements=known), repairs

    def solved(self) -> tuple[LagWindow, Optimum, list[Repair]]:
        """At its optimum, without the landmarks that have none.

        Raises
        ------
        IndeterminateError
            If the states are not determined; its column counts from the first state's on.
        """
        window, repairs = self, list[Repair]()
        while True:
            variables = Variables(window.states, window.landmarks)
            try:
                optimum = minimize(window._cost(), variables, self.sensor.config)
                lost = optimum.hidden
            except IndeterminateError as error:
                if error.column >= variables.first_state:
                    raise IndeterminateError(error.column - variables.first_state) from error
                lost = variables.landmarks.number[error.column // 3 :][:1]
            if len(lost) == 0:
                found = optimum.variables
                return (
                    replace(window, states=found.states, landmarks=found.landmarks),
                    optimum,
                    repairs,
                )
            dropped = window.measurements[np.isin(window.measurements.landmark, lost)]
            repairs += repairs_of(dropped, "indeterminate: landmark left out")
            window = window.without(lost)

    def deviations(self, stop: float = np.inf) -> Deviations:
        """Those of the states at unique times before `stop`.

        A landmark that is measured once tells nothing: the state at its time is the interpolated.
        """
        early = self.measurements[self.measurements.t < stop]
        cost = replace(self._cost(), measurements=self._usable(early))
        told = cost.deviations(Variables(self.states, self.landmarks))
        t = np.unique(early.t)
        local = np.zeros((len(t), 12))
        local[np.searchsorted(t, told.t)] = told.local
        return Deviations(t, local)

    def without(self, numbers: Index) -> LagWindow:
        """Without landmarks of these numbers and all that was measured of them."""
        return replace(
            self,
            landmarks=self.landmarks[~np.isin(self.landmarks.number, numbers)],
            measurements=self.measurements[~np.isin(self.measurements.landmark, numbers)],
            prior=self.prior.without(numbers),
        )

    def marginalized(self, count: int, optimum: Optimum) -> LagWindow:
        """Without its first states and with what their measurements told in the prior.

        The optimum is the one that the window was solved to.
        """
        if count == 0:
            return self
        start, measurements = self.states.t[count], self.measurements
        leaving = measurements.t < start
        told = self._usable(measurements[leaving])
        stays = self.landmarks.among(measurements.landmark[~leaving])
        concerned = self.landmarks.among(told.landmark)
        concerned |= self.landmarks.among(self.prior.landmarks.number)
        here = optimum.linearized
        part = Variables(here.states[: count + 1], here.landmarks[concerned])
        kept = np.flatnonzero(stays[concerned])
        columns, out = _columns_with_last(count, kept, len(part.landmarks))
        quadratic = replace(optimum.cost, measurements=told).quadratic(part, columns)
        prior = MarginalPrior(
            part.states.T_world_cam[-1],
            part.states.twist[-1],
            part.landmarks[kept],
            quadratic.marginal(out),
        )
        return LagWindow(
            self.sensor,
            self.states[count:],
            self.landmarks[stays],
            measurements[~leaving],
            prior,
        )

    def _cost(self) -> WindowCost:
        config = self.sensor.config
        loss = RobustLoss(config.loss, config.loss_scale)
        usable = self._usable(self.measurements)
        unique = config.state_interval == 0
        return WindowCost(self.sensor.camera, self.sensor.noise, loss, self.prior, usable, unique)

    def _usable(self, measurements: Measurements) -> Measurements:
        return measurements[self.landmarks.contains(measurements.landmark)]

    def inside_gate(self, new: Measurements) -> NDArray[np.bool_]:
        """(N,) which measurements lie where the window predicts them; of unknown landmarks all."""
        inside = np.ones(len(new), bool)
        known = np.flatnonzero(self.landmarks.contains(new.landmark))
        if len(known) == 0:
            return inside
        variables = Variables(self.states, self.landmarks)
        predicted = replace(self._cost(), measurements=new[known])
        rows, columns = predicted.stereo(variables)[0], predicted.columns(variables)
        combinations = np.zeros((variables.columns.size, len(known), 3))
        n = np.arange(len(known))[:, None, None]
        combinations[columns[:, :, None], n, np.arange(3)] = rows[..., :-1].transpose(0, 2, 1)
        root = self._cost().quadratic(variables).root(combinations.reshape(len(combinations), -1))
        root = root.reshape(-1, len(known), 3)
        spread = np.eye(3) + np.einsum("dni,dnj->nij", root, root)
        error = rows[..., -1:]
        distance = np.einsum("nij,nij->n", error, np.linalg.solve(spread, error))
        inside[known] = distance <= chi2.ppf(self.sensor.config.gate, 3)
        return inside


def _columns_with_last(state: int, landmarks: Index, count: int) -> tuple[Columns, int]:
    """Columns of states and `count` landmarks with the last state and some landmarks at the end.

    And the number of columns before these.
    """
    others = np.setdiff1d(np.arange(count), landmarks)
    out = 12 * state + 3 * len(others)
    of_landmark = np.empty(count, np.int64)
    of_landmark[others] = 12 * state + 3 * np.arange(len(others))
    of_landmark[landmarks] = out + 12 + 3 * np.arange(len(landmarks))
    return Columns(np.append(12 * np.arange(state), out), of_landmark), out


def new_times(last: float, measured: Array, stop: float, interval: float) -> Array:
    """Times of states after the last one up to `stop`, an interval or less apart.

    There is none in a gap before the first measurement, but at its end.
    """
    if stop - last <= SAME_TIME:
        return np.empty(0)
    later = measured[measured > last]
    start = min(float(later.min()) if len(later) else stop, stop)
    times = [last]
    if start - last > interval:
        times.append(start)
    if stop - times[-1] > SAME_TIME:
        count = int(np.ceil((stop - times[-1]) / interval - 1e-6))
        times += np.linspace(times[-1], stop, max(count, 1) + 1)[1:].tolist()
    return np.array(times[1:])
