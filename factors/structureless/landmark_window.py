"""Measurements of a structureless factor in a window of states, linearised without landmarks."""

from __future__ import annotations

from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors.kernels.se3 import Array
from factors.linear_states import steps_kernel
from factors.stereo import StereoCamera
from factors.structureless.bracketing_states import BracketingStates
from factors.structureless.bridge import Bridge
from factors.structureless.fitted_landmarks import Fit, FittedLandmarks
from factors.structureless.joint_system import JointSystem, Rows, root_kernel
from factors.structureless.landmark_prior import LandmarkPrior
from factors.structureless.row_kernels import measurement_rows_kernel
from factors.structureless.states_between import StatesBetween

Index = NDArray[np.int64]


class Linearization(NamedTuple):
    """Where a window was linearised, and what came of it: `root` are the rows on the states."""

    T_states: Array
    v_states: Array
    fit: Fit
    system: JointSystem
    bridges: list[Bridge]
    root: Array


class LandmarkWindow:
    """The measurements of a structureless factor, in order of landmarks and times, and its error.

    Attributes
    ----------
    between, landmarks
        States and times; landmarks, their measurements, and what is known of them.
    size
        Number of errors.
    """

    def __init__(
        self,
        between: BracketingStates,
        t: Array,
        landmarks: FittedLandmarks,
        qc_root: Array | None,
        tolerance: float,
    ) -> None:
        self.between, self.t, self.landmarks = between, t, landmarks
        self.size = 12 * len(between.states) + 1
        self.qc_root, self._tolerance = qc_root, tolerance
        self._linearized: Linearization | None = None
        self._moved: tuple[Array, Array] | None = None  # steps, and coordinates after them

    @property
    def prior(self) -> LandmarkPrior:
        """What is known of the landmarks."""
        return self.landmarks.prior

    def error(self, values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
        """Return (12 m + 1,) errors, and their Jacobians of each pose and velocity if asked for."""
        T_states, v_states = self.between.read(values)
        if jacobians is None:
            return self._cost(T_states, v_states)
        root, by_body = self.linearized(T_states, v_states).root, self.between.by_body
        for block in range(2 * len(self.between.states)):
            columns = root[:, 6 * block : 6 * block + 6]
            jacobians[block] = columns if by_body is None else columns @ by_body
        return root[:, -1]

    def fit(self, T_states: Array, v_states: Array) -> Fit:
        """Landmarks that fit best, given the states of the graph."""
        offset = np.ascontiguousarray(self.prior.at(T_states[0], v_states[0])[:, :, -1])
        return self.landmarks.fit(self.between.poses(T_states, v_states), T_states[0], offset)

    def moved_fit(self, T_states: Array, v_states: Array, count: int) -> Fit:
        """Return the landmarks where the last Gauss-Newton step took them, or where they fit.

        Poses are those of measurements between the first `count` states alone.
        """
        at = self._linearized
        if at is None:
            return self.fit(T_states, v_states)
        moved = steps_kernel(at.T_states, at.v_states, T_states, v_states)
        if self._moved is None or not np.array_equal(self._moved[0], moved):
            self._moved = moved, at.fit.coordinates + at.system.landmark_steps(moved)
        T = self.between.poses(T_states, v_states, count)
        return at.fit._replace(T=T, coordinates=self._moved[1])

    def prior_shared(self, T_states: Array, v_states: Array) -> Array:
        """Return the variables s (d,) of the prior that are most likely, given the states."""
        at = self._linearized
        if at is None:
            return np.zeros(self.prior.shared)
        moved = steps_kernel(at.T_states, at.v_states, T_states, v_states)
        return at.system.shared_mean(moved)[at.system.latent[-1] :]

    def rows(self, T_states: Array, v_states: Array, fit: Fit, states: int) -> Rows:
        """Linearised measurements between the first `states` states, and the prior."""
        between, landmarks = self.between, self.landmarks
        order = np.argsort(between.first, kind="stable")
        order = order[: np.searchsorted(between.first[order], states - 1)]
        interval = between.first[order]
        measured = landmarks.of, landmarks.measured, landmarks.whitening, fit.weights
        rows, by_landmark = self._measurement_rows(
            T_states, v_states, order, between, fit, *measured
        )
        if self.qc_root is not None:
            rows[:, :, 24:30] *= self.qc_root
        bridges = self._bridges(order, interval, rows, states)
        prior = self._prior_rows(T_states[0], v_states[0], fit)
        return Rows(interval, landmarks.of[order], rows, by_landmark, bridges, *prior)

    def linearized(self, T_states: Array, v_states: Array) -> Linearization:
        """Linearise at the states. iSAM2 linearises a new factor twice at the same values."""
        kept = self._linearized
        if kept is None or not (
            np.array_equal(T_states, kept.T_states) and np.array_equal(v_states, kept.v_states)
        ):
            fit = self.fit(T_states, v_states)
            rows = self.rows(T_states, v_states, fit, len(T_states))
            system = JointSystem.of_rows(rows, len(fit.coordinates))
            try:
                root = root_kernel(*system.on_states())
            except np.linalg.LinAlgError:  # a callback must not raise
                root = np.full((self.size, self.size), np.nan)
            kept = Linearization(T_states, v_states, fit, system, rows.bridges, root)
            self._linearized, self._moved = kept, None
        return kept

    def states_between(self, T_states: Array, v_states: Array) -> StatesBetween:
        """Return states at the measurements' times; those of the graph may have moved since."""
        at = self._linearized or self.linearized(T_states, v_states)
        moved = steps_kernel(at.T_states, at.v_states, T_states, v_states)
        qc_root = np.zeros(6) if self.qc_root is None else self.qc_root
        states = self.between.t, T_states, v_states
        return StatesBetween.given(at.system, at.bridges, moved, self.t, qc_root, *states)

    def residuals(self, T_states: Array, v_states: Array) -> Array:
        """Return the errors (n, 3) of the measurements from the landmarks that fit best."""
        fit = self.fit(T_states, v_states)
        T, points = fit.T, fit.points()[self.landmarks.of]
        local = np.einsum("nji,nj->ni", T[:, :3, :3], points - T[:, :3, 3])
        return StereoCamera(*self.landmarks.camera).project(local) - self.landmarks.measured

    def squared_distances(
        self,
        T_states: Array,
        v_states: Array,
        measured: Array,
        t: Array,
        number: Index,
        deviations: Array,
        covariance: Array,
    ) -> Array:
        """Return squared Mahalanobis distances (n,) of other measurements from their prediction."""
        at, distance = self.linearized(T_states, v_states), np.full(len(t), np.nan)
        determined = at.system.known
        if not len(determined):
            return distance
        of = np.minimum(np.searchsorted(self.landmarks.number, number), len(determined) - 1)
        known = (self.landmarks.number[of] == number) & determined[of]
        if not known.any():
            return distance
        order, between = np.flatnonzero(known), self.between.at(t)
        fit = at.fit._replace(T=between.poses(T_states, v_states))
        new = of, measured, self.landmarks.whitening_of(deviations), np.ones(len(t))
        rows, by_landmark = self._measurement_rows(T_states, v_states, order, between, fit, *new)
        first = 12 * between.first[order]
        a, b = between.a[order], between.b[order]
        # Given both states, the variance of xi between them is Q_c a^3 b^3 / (3 (a + b)^3).
        own = rows[:, :, 24:30] * (0.0 if self.qc_root is None else self.qc_root)
        bridge = (a * b / (a + b)) ** 3 / 3
        error, spread = at.system.predicted(of[order], first, rows, by_landmark, covariance)
        spread += bridge[:, None, None] * (own @ own.transpose(0, 2, 1))
        solved = np.linalg.solve(spread, error[..., None])[..., 0]
        distance[order] = np.einsum("nr,nr->n", error, solved)
        return distance

    def _measurement_rows(
        self,
        T_states: Array,
        v_states: Array,
        order: Index,
        between: BracketingStates,
        fit: Fit,
        of: Index,
        measured: Array,
        whitening: Array,
        weights: Array,
    ) -> tuple[Array, Array]:
        """Return what `measurement_rows_kernel` does, of measurements of the window's landmarks."""
        camera = self.landmarks.camera
        states = T_states, v_states, order, between.first, between.a, between.b, fit.T
        known = of, fit.charts, fit.coordinates, measured, camera, whitening, weights
        return measurement_rows_kernel(*states, *known)

    def _cost(self, T_states: Array, v_states: Array) -> Array:
        """(12 m + 1,) zeros except the last: half its square is the cost."""
        error = np.zeros(self.size)
        fit = self.fit(T_states, v_states)
        square: Any = 2 * self.landmarks.loss.total(fit.distances)
        if self.qc_root is not None or len(self.prior):
            found = self.linearized(T_states, v_states).root[:, -1]
            square += found @ found - fit.weights @ fit.distances**2
        error[-1] = np.sqrt(max(square, 0.0))
        return error

    def _bridges(self, order: Index, interval: Index, rows: Array, states: int) -> list[Bridge]:
        """The bridge between each state and the next."""
        ends = np.searchsorted(interval, np.arange(states))
        scale = np.einsum("nrc,nrc->n", rows[:, :, 24:30], rows[:, :, 24:30])
        bridges = []
        for i, duration in enumerate(np.diff(self.between.t[:states]).tolist()):
            part = slice(ends[i], ends[i + 1])
            times = self.between.a[order[part]]
            if self.qc_root is None:
                bridges.append(Bridge.rigid(len(times), duration))
            else:
                bridges.append(Bridge.through(times, duration, scale[part], self._tolerance))
        return bridges

    def _prior_rows(self, T_first: Array, v_first: Array, fit: Fit) -> tuple[Array, Array, Index]:
        """Rows (P, 3, d + 12 + 1) and (P, 3, 3) of the prior, and its landmarks (P,)."""
        of, rows = self.landmarks.with_prior, self.prior.at(T_first, v_first)
        seen = fit.charts[of], fit.coordinates[of]
        return rows, self.prior.with_landmarks(T_first, rows, *seen), of
