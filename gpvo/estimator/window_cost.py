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
from gpvo.config.stages import NoiseConfig
from gpvo.estimator.gaussian import Quadratic
from gpvo.estimator.landmarks import Landmarks
from gpvo.estimator.marginal_prior import MarginalPrior
from gpvo.estimator.normal_kernels import add_block_kernel, add_motion_kernel, add_stereo_kernel
from gpvo.estimator.robust import RobustLoss
from gpvo.estimator.unique_times import Bridge, Deviations, groups
from gpvo.estimator.window_kernels import errors_kernel, motion_kernel, stereo_kernel
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Columns:
    """Where variables lie in an information matrix.

    Attributes
    ----------
    state
        (K,) first columns of the states, twelve each: pose, perturbed on the right, then twist.
    landmark
        (L,) first columns of the landmarks, three each.
    """

    state: Index
    landmark: Index

    @property
    def size(self) -> int:
        """Number of columns."""
        return 12 * len(self.state) + 3 * len(self.landmark)


@dataclass(frozen=True, eq=False)
class Variables:
    """What is estimated: K states and L landmarks."""

    states: States
    landmarks: Landmarks

    @property
    def first_state(self) -> int:
        """Column of the first state."""
        return 3 * len(self.landmarks)

    @property
    def columns(self) -> Columns:
        """The landmarks in order of their numbers, then the states in order of time."""
        state = self.first_state + 12 * np.arange(len(self.states))
        return Columns(state, 3 * np.arange(len(self.landmarks)))

    def moved(self, step: Array) -> Variables:
        """Perturbed by a step (3 L + 12 K,) of these columns."""
        states = self.states
        of_landmarks = step[: self.first_state].reshape(-1, 3)
        of_states = step[self.first_state :].reshape(-1, 12)
        T_world_cam = states.T_world_cam @ se3_exp(of_states[:, :6])
        moved = States(states.t, T_world_cam, states.twist + of_states[:, 6:])
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
        return self.value_and_depths(variables)[0]

    def value_and_depths(self, variables: Variables) -> tuple[float, Array]:
        """The cost, and (N,) depths of the landmarks in the cameras that measured them."""
        deviation = self.prior.deviation(variables.states, variables.landmarks)
        motion = self._motion(variables.states, False)[..., -1]
        errors, depth = self.errors(variables)
        stereo = self.loss.cost(np.sum(errors**2, axis=1))
        cost = self.prior.quadratic.cost(deviation) + np.sum(motion**2) + np.sum(stereo)
        return float(cost), depth

    def squared_errors(self, variables: Variables) -> Array:
        """(N,) squared Mahalanobis norms of the reprojection errors."""
        return np.asarray(np.sum(self.errors(variables)[0] ** 2, axis=1))

    def linearization_point(self, variables: Variables) -> Variables:
        """Where to linearize the cost: the variables, but those of the prior where it was made.

        Derivatives at two different points would tell what no measurement did (Huang et al.,
        "First-estimates Jacobian EKF", 2009).
        """
        return Variables(*self.prior.imposed(variables.states, variables.landmarks))

    def quadratic(self, variables: Variables, columns: Columns | None = None) -> Quadratic:
        """The cost of a step from the variables on, to second order (Gauss-Newton).

        The columns are those of the variables if others are not asked for.
        """
        columns = columns or variables.columns
        H, g = np.zeros((columns.size, columns.size)), np.zeros(columns.size)
        cost = self._add_prior(variables, columns, H, g)
        motion = self._motion(variables.states, True)
        add_motion_kernel(motion, columns.state, H, g)
        stereo, by_local = self.stereo(variables)
        squares = np.sum(stereo[..., -1] ** 2, axis=1)
        cost += float(np.sum(motion[..., -1] ** 2) + np.sum(self.loss.cost(squares)))
        weight = np.sqrt(self.loss.weight(squares))[:, None, None]
        stereo *= weight
        landmark = columns.landmark[variables.landmarks.index(self.measurements.landmark)]
        interval = self._intervals(variables.states)
        if not self.unique:
            add_stereo_kernel(stereo, interval, landmark, columns.state, H, g)
            return Quadratic(H, g, cost)
        for group, bridge in self._bridges(variables.states, stereo, weight * by_local):
            k = interval[group.start]
            bridge.add_normal(landmark[group], columns.state[k : k + 2], H, g)
        return Quadratic(H, g, cost)

    def _add_prior(self, variables: Variables, columns: Columns, H: Array, g: Array) -> float:
        """Add the prior to H and g; its cost."""
        prior = self.prior.quadratic
        deviation = self.prior.deviation(variables.states, variables.landmarks)
        index = variables.landmarks.index(self.prior.landmarks.number)
        landmarks = columns.landmark[index, None] + np.arange(3)
        own = np.concatenate([columns.state[0] + np.arange(12), landmarks.ravel()])
        add_block_kernel(prior.H, own, H)
        gradient = prior.g + prior.H @ deviation
        g[own] += gradient
        return float(deviation @ (gradient + prior.g)) + prior.c

    def deviations(self, variables: Variables) -> Deviations:
        """Most probable deviations of the states at unique times from the interpolated ones."""
        stereo, by_local = self.stereo(variables)
        weight = np.sqrt(self.loss.weight(np.sum(stereo[..., -1] ** 2, axis=1)))[:, None, None]
        bridges = self._bridges(variables.states, weight * stereo, weight * by_local)
        local = [bridge.deviations() for _, bridge in bridges]
        t, first = np.unique(self.measurements.t, return_index=True)
        return Deviations(t, np.concatenate([np.empty((0, 12)), *local])[first])

    def _bridges(
        self, states: States, stereo: Array, by_local: Array
    ) -> Iterator[tuple[slice, Bridge]]:
        """The measurements of each interval between states, of weighted errors."""
        interval, qc = self._intervals(states), np.array(self.noise.acceleration_psd)
        for group in groups(interval):
            start, stop = states.t[interval[group.start] :][:2]
            after = self.measurements.t[group] - start
            yield group, Bridge(stereo[group], by_local[group], after, stop - start, qc)

    def stereo(self, variables: Variables) -> tuple[Array, Array]:
        """(N, 3, 28) and (N, 3, 6) whitened errors and derivatives; see `stereo_kernel`."""
        count = len(self.measurements)
        result, by_local = np.empty((count, 3, 28)), np.empty((count, 3, 6))
        stereo_kernel(*self._measured(variables), result, by_local)
        return result, by_local

    def columns(self, variables: Variables) -> Index:
        """(N, 27) columns of both states and the landmark of each measurement."""
        columns = variables.columns
        landmark = columns.landmark[variables.landmarks.index(self.measurements.landmark)]
        state = columns.state[self._intervals(variables.states)]
        own = [state[:, None] + np.arange(24), landmark[:, None] + np.arange(3)]
        return np.hstack(own)

    def errors(self, variables: Variables) -> tuple[Array, Array]:
        """(N, 3) whitened errors of the measurements, and (N,) depths of their landmarks."""
        result = np.empty((len(self.measurements), 4))
        errors_kernel(*self._measured(variables), result)
        return result[:, :3], result[:, 3]

    def _measured(self, variables: Variables) -> tuple[Array | Index, ...]:
        """What the kernels take: states, measurements, landmarks, and sensor."""
        states, landmarks = variables.states, variables.landmarks
        return (
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
        )

    def _intervals(self, states: States) -> Index:
        """(N,) numbers of the states before the measurements."""
        before = np.searchsorted(states.t, self.measurements.t, "right") - 1
        return np.clip(before, 0, len(states) - 2)

    def _motion(self, states: States, derivatives: bool) -> Array:
        result = np.empty((len(states) - 1, 12, 25))
        roots = 1 / np.sqrt(np.array(self.noise.acceleration_psd))
        motion_kernel(states.T_world_cam, states.twist, states.t, roots, derivatives, result)
        return result
