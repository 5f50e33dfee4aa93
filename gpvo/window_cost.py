"""The cost of section III-C over a window of states, and its quadratic approximation.

J = marginal prior + WNOA priors between the states + losses of the reprojection errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp
from gpvo.config import NoiseConfig
from gpvo.gaussian import Quadratic
from gpvo.landmarks import Landmarks
from gpvo.marginal_prior import MarginalPrior, landmark_columns
from gpvo.robust import RobustLoss
from gpvo.states import States
from gpvo.tracklets import Measurements
from gpvo.unique_times import Bridge, Deviations, bridge_covariance, groups
from gpvo.window_kernels import add_normal_kernel, motion_kernel, stereo_kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Variables:
    """What is estimated: K states and L landmarks, 12 K + 3 L columns in this order."""

    states: States
    landmarks: Landmarks

    @property
    def first_landmark(self) -> int:
        """Column of the first landmark."""
        return 12 * len(self.states)

    def moved(self, step: Array) -> Variables:
        """Perturbed by a step (12 K + 3 L,), poses on the right."""
        states = self.states
        of_states = step[: self.first_landmark].reshape(-1, 12)
        T_world_cam = states.T_world_cam @ se3_exp(of_states[:, :6])
        moved = States(states.t, T_world_cam, states.twist + of_states[:, 6:])
        of_landmarks = step[self.first_landmark :].reshape(-1, 3)
        return Variables(moved, self.landmarks.moved(of_landmarks))


@dataclass(frozen=True, eq=False)
class WindowCost:
    """The cost of variables, given measurements in order of time.

    Attributes
    ----------
    camera, noise, loss
        The sensor, its noise, and the loss of a measurement.
    prior
        Of the first state and landmarks.
    measurements
        Between the first and the last state, of the window's landmarks.
    unique
        Whether every time of a measurement has a state of its own, which is eliminated; without,
        the states at these times are the interpolated ones.
    """

    camera: StereoCamera
    noise: NoiseConfig
    loss: RobustLoss
    prior: MarginalPrior
    measurements: Measurements
    unique: bool = False

    def value(self, variables: Variables) -> float:
        """The cost itself; not finite if a landmark is at no place."""
        deviation = self.prior.deviation(variables.states, variables.landmarks)
        motion = self._motion(variables.states, False)[..., -1]
        stereo = self.loss.cost(self.squared_errors(variables))
        return self.prior.quadratic.cost(deviation) + float(np.sum(motion**2) + np.sum(stereo))

    def squared_errors(self, variables: Variables) -> Array:
        """(N,) squared Mahalanobis norms of the reprojection errors."""
        return np.sum(self.stereo(variables, False)[0][..., -1] ** 2, axis=1)

    def hidden(self, variables: Variables) -> Index:
        """Numbers of the landmarks that are behind the camera at one of their measurements."""
        T_world_cam, _ = variables.states.query(self.measurements.t)
        points = variables.landmarks.points()
        points = points[variables.landmarks.index(self.measurements.landmark)]
        offset = points - T_world_cam[:, :3, 3]
        depth = np.einsum("ni,ni->n", T_world_cam[:, :3, 2], offset)
        return np.unique(self.measurements.landmark[~(depth > 0)])

    def linearization_point(self, variables: Variables) -> Variables:
        """Where to linearize the cost: the variables, but those of the prior where it was made.

        Derivatives at two different points would tell what no measurement did (Huang et al.,
        "First-estimates Jacobian EKF", 2009).
        """
        return Variables(*self.prior.imposed(variables.states, variables.landmarks))

    def quadratic(self, variables: Variables) -> Quadratic:
        """The cost of a step from the variables on, to second order (Gauss-Newton)."""
        size = variables.first_landmark + 3 * len(variables.landmarks)
        H, g = np.zeros((size, size)), np.zeros(size)
        columns = self.prior.columns(variables.landmarks, variables.first_landmark)
        deviation = self.prior.deviation(variables.states, variables.landmarks)
        H[np.ix_(columns, columns)] = self.prior.quadratic.H
        g[columns] = self.prior.quadratic.g + self.prior.quadratic.H @ deviation
        motion, (stereo, by_local) = self._motion(variables.states, True), self.stereo(variables)
        squares = np.sum(stereo[..., -1] ** 2, axis=1)
        cost = self.prior.quadratic.cost(deviation) + float(np.sum(motion[..., -1] ** 2))
        cost += float(np.sum(self.loss.cost(squares)))
        add_normal_kernel(motion, _state_columns(np.arange(len(motion))), H, g)
        if self.unique:
            for bridge in self.bridges(variables, stereo, by_local):
                bridge.add_normal(H, g)
        else:
            stereo *= np.sqrt(self.loss.weight(squares))[:, None, None]
            add_normal_kernel(stereo, self.columns(variables), H, g)
        return Quadratic(H, g, cost)

    def deviations(self, variables: Variables) -> Deviations:
        """Most probable deviations of the states at unique times from the interpolated ones."""
        bridges = self.bridges(variables, *self.stereo(variables))
        local = [bridge.deviations() for bridge in bridges]
        t, first = np.unique(self.measurements.t, return_index=True)
        return Deviations(t, np.concatenate([np.empty((0, 12)), *local])[first])

    def bridges(self, variables: Variables, stereo: Array, by_local: Array) -> Iterator[Bridge]:
        """The measurements of each interval between states, weighted by the loss."""
        weight = self.loss.weight(np.sum(stereo[..., -1] ** 2, axis=1))
        stereo, by_local = (np.sqrt(weight)[:, None, None] * rows for rows in (stereo, by_local))
        columns, interval = self.columns(variables), self._intervals(variables.states)
        t, qc = variables.states.t, np.array(self.noise.acceleration_psd)
        for group in groups(interval):
            k = interval[group.start]
            spread = bridge_covariance(self.measurements.t[group] - t[k], t[k + 1] - t[k])
            yield Bridge(stereo[group], columns[group], by_local[group], spread, qc)

    def stereo(self, variables: Variables, derivatives: bool = True) -> tuple[Array, Array]:
        """(N, 3, 28) and (N, 3, 6) whitened errors of the measurements; see `stereo_kernel`."""
        states, landmarks = variables.states, variables.landmarks
        result, by_local = np.empty((len(self.measurements), 3, 28)), np.empty((0, 3, 6))
        if derivatives:
            by_local = np.empty((len(self.measurements), 3, 6))
        stereo_kernel(
            states.T_world_cam,
            states.twist,
            states.t,
            self.measurements.t,
            self._intervals(states),
            landmarks.index(self.measurements.landmark),
            landmarks.T_world_chart,
            landmarks.coordinates,
            self.measurements.stereo,
            self.camera.parameters,
            np.sqrt(np.array(self.noise.measurement_information)),
            derivatives,
            result,
            by_local,
        )
        return result, by_local

    def columns(self, variables: Variables) -> Index:
        """(N, 27) columns of both states and the landmark of each measurement."""
        landmark = variables.landmarks.index(self.measurements.landmark)
        points = landmark_columns(landmark, variables.first_landmark).reshape(-1, 3)
        return np.hstack([_state_columns(self._intervals(variables.states)), points])

    def _intervals(self, states: States) -> Index:
        """(N,) numbers of the states before the measurements."""
        before = np.searchsorted(states.t, self.measurements.t, "right") - 1
        return np.clip(before, 0, len(states) - 2)

    def _motion(self, states: States, derivatives: bool) -> Array:
        result = np.empty((len(states) - 1, 12, 25))
        roots = 1 / np.sqrt(np.array(self.noise.acceleration_psd))
        motion_kernel(states.T_world_cam, states.twist, states.t, roots, derivatives, result)
        return result


def _state_columns(before: Index) -> Index:
    """(N, 24) columns of the states with these numbers (N,) and of the next of each."""
    return 12 * before[:, None] + np.arange(24)
