"""Measurements of many landmarks, each at its own time, in one factor without the landmarks.

All landmarks are eliminated where the factor is evaluated, and what they tell of the states is
compressed to as many rows as the states have columns. GTSAM then sees a chain of states alone,
however many landmarks there are (structureless factors: Carlone et al., "Eliminating conditionally
independent sets in factor graphs", 2014). With Q_c, the states at the measurements' own times are
eliminated, too (`Bridge`), and a prior carries what earlier measurements know of the landmarks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import (
    Pose,
    checked_finite_noise,
    checked_number,
    checked_pose,
    power_spectral_density,
)
from factors.factor import Factor
from factors.kernels.se3 import Array
from factors.stereo import Camera, StereoCamera, StereoMeasurements, as_camera, stereo_measurements
from factors.structureless.bracketing_states import BracketingStates, checked_times
from factors.structureless.bridge import Bridge
from factors.structureless.fitted_landmarks import Fit, FittedLandmarks, checked_measurements
from factors.structureless.joint_system import JointSystem, Rows, root_kernel
from factors.structureless.landmark_prior import LandmarkPrior
from factors.structureless.prior_kernels import prior_system_kernel
from factors.structureless.row_kernels import measurement_rows_kernel
from factors.structureless.states_between import StatesBetween
from factors.variables import State, as_state

Index = NDArray[np.int64]

TOLERANCE = 1e-4
"""Variance, of that of a measurement, that is neglected between states at unique times."""


class StructurelessStereoFactor(Factor):
    """Stereo measurements of many landmarks at their own times, the landmarks eliminated.

    Parameters
    ----------
    measured
        (n, 3) measurements (u_left, v, disparity) in rectified pixels; or n gtsam.StereoPoint2, and
        the noise is that of (u_left, u_right, v).
    times
        (n,) their times in seconds.
    landmarks
        (n,) integers: measurements of equal ones are of the same landmark; or one for all. A
        landmark that is measured once has no information on the states.
    model
        Noise model of one measurement, dimension 3, not Constrained. A robust one weights each
        measurement by itself, by the norm of its whitened error.
    states
        (pose key, velocity key, time), or gtsam.StateData, in order of time: Pose3 T_world_cam,
        body twist (6,) with the rotation first, seconds. The factor takes those that bracket a
        measurement, or all if there is a Q_c or a prior.
    camera
        Intrinsics of the rectified pair; or gtsam.Cal3_S2Stereo.
    qc
        Power spectral density, diagonal (6,): every time is then a state of its own, tied to the
        others by the WNOA prior, and eliminated. Without, the states between are interpolated.
    prior
        What measurements before the first of the states know of the landmarks.
    tolerance
        Variance of the states between that may be neglected, as a share of a measurement's.
    T_body_cam
        (4, 4) pose of the left camera in the body, or gtsam.Pose3, if the states are the body's;
        then without Q_c and prior. What the factor tells of states is still of the camera.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, times lie outside the states, or a
        disparity is not positive.

    Notes
    -----
    Its errors are 12 for each state and one more; half their squared norm is the cost of all
    measurements, and the Jacobian gives its gradient: exact without Q_c and prior, with them to
    first order in the eliminated variables, whose robust weights are those of interpolated states.
    While a landmark is behind one of the cameras, that measurement has GTSAM's large constant error
    and no Jacobian. One factor of many landmarks is much faster than one factor for each.
    """

    def __init__(
        self,
        measured: StereoMeasurements,
        times: ArrayLike,
        landmarks: ArrayLike,
        model: gtsam.noiseModel.Base,
        states: Sequence[State],
        camera: Camera,
        qc: ArrayLike | None = None,
        prior: LandmarkPrior | None = None,
        tolerance: float = TOLERANCE,
        T_body_cam: Pose | None = None,
    ) -> None:
        measurements, model = stereo_measurements(measured, model)
        measurements = checked_measurements(measurements)
        t = checked_times(times, len(measurements))
        number = _checked_landmarks(landmarks, len(t))
        checked_finite_noise(model, 3)
        camera = as_camera(camera)
        if prior is None and len(t) < 2:
            raise ValueError(f"measured must have two rows or more, not {len(t)}")
        tolerance = checked_number("tolerance", tolerance)
        if tolerance < 0:
            raise ValueError(f"tolerance must not be negative, not {tolerance}")
        if not (prior is None or isinstance(prior, LandmarkPrior)):
            raise ValueError(f"prior must be a LandmarkPrior, not {type(prior).__name__}")
        roots = None if qc is None else np.sqrt(_diagonal(qc))
        named_states = [as_state("states", state) for state in states]
        T_mount = None if T_body_cam is None else checked_pose("T_body_cam", T_body_cam)
        made_of = {
            "measured": measurements,
            "times": t,
            "landmarks": number,
            "model": model,
            "states": named_states,
            "camera": camera,
            "qc": None if qc is None else np.array(qc, np.float64),
            "prior": prior,
            "tolerance": tolerance,
            "T_body_cam": T_mount,
        }
        if T_body_cam is not None and not (qc is None and prior is None):
            raise ValueError(
                "T_body_cam must not be given with qc or prior: these are the camera's"
            )
        order = np.lexsort((t, number))
        self._place = np.argsort(order)
        every = not (qc is None and prior is None)
        between = BracketingStates(t[order], named_states, every, T_mount)
        prior = LandmarkPrior.none() if prior is None else prior
        found = FittedLandmarks(measurements[order], number[order], model, camera, prior)
        self.window = window = LandmarkWindow(between, t[order], found, prior, roots, tolerance)
        unit = gtsam.noiseModel.Unit.Create(window.size)
        super().__init__(unit, between.variables, window.error, made_of)

    def landmarks(self, values: gtsam.Values) -> tuple[Index, Array]:
        """Return (L,) increasing landmarks and the (L, 3) points in the world that fit best.

        One whose rays diverge fits best beyond infinity: a point behind the cameras.
        """
        fit = self.window.fit(*self.window.between.read(values))
        return self.landmark_numbers, fit.points()

    @property
    def landmark_numbers(self) -> Index:
        """Landmarks (L,), increasing, those of the prior as well."""
        return self.window.landmarks.number

    def states_between(self, values: gtsam.Values) -> StatesBetween:
        """Return the states at the measurements' own times, given those of the graph."""
        return self.window.states_between(*self.window.between.read(values))

    def residuals(self, values: gtsam.Values) -> Array:
        """Return the errors (n, 3) of the measurements, predicted less measured, pixels."""
        return self.window.residuals(*self.window.between.read(values))[self._place]

    def squared_distances(
        self,
        values: gtsam.Values,
        measured: ArrayLike,
        times: ArrayLike,
        landmarks: ArrayLike,
        covariance: Array,
    ) -> Array:
        """Return squared Mahalanobis distances (n,) of new measurements from their prediction.

        `covariance` (12 m, 12 m) is that of the states, given all but the new measurements. The
        distance of a landmark that the factor does not know is not a number.
        """
        measurements = checked_measurements(measured)
        t = checked_times(times, len(measurements))
        number = _checked_landmarks(landmarks, len(t))
        states = self.window.between.read(values)
        size = 12 * len(states[0])
        if np.shape(covariance) != (size, size):
            raise ValueError(f"covariance must be ({size}, {size}), not {np.shape(covariance)}")
        by_body = self.window.between.by_body
        if by_body is not None:
            by_bodies = np.kron(np.eye(size // 6), by_body)
            covariance = by_bodies @ covariance @ by_bodies.T
        return self.window.squared_distances(*states, measurements, t, number, covariance)


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
    between, landmarks, prior
        States and times, landmarks and their measurements, what is known of these.
    size
        Number of errors.
    """

    def __init__(
        self,
        between: BracketingStates,
        t: Array,
        landmarks: FittedLandmarks,
        prior: LandmarkPrior,
        qc_root: Array | None,
        tolerance: float,
    ) -> None:
        self.between, self.t, self.landmarks, self.prior = between, t, landmarks, prior
        self.size = 12 * len(between.states) + 1
        self.qc_root, self._tolerance = qc_root, tolerance
        self._linearized: Linearization | None = None

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
        moved = StatesBetween.moved_by(at.T_states, at.v_states, T_states, v_states)
        coordinates = at.fit.coordinates + at.system.landmark_steps(moved)
        T = self.between.poses(T_states, v_states, count)
        return at.fit._replace(T=T, coordinates=coordinates)

    def rows(self, T_states: Array, v_states: Array, fit: Fit, states: int) -> Rows:
        """Linearised measurements between the first `states` states, and the prior."""
        between, landmarks = self.between, self.landmarks
        order = np.argsort(between.first, kind="stable")
        order = order[: np.searchsorted(between.first[order], states - 1)]
        interval = between.first[order]
        rows, by_landmark = measurement_rows_kernel(
            T_states,
            v_states,
            order,
            between.first,
            between.a,
            between.b,
            fit.T,
            landmarks.of,
            fit.charts,
            fit.coordinates,
            landmarks.measured,
            landmarks.camera,
            landmarks.whitening,
            fit.weights,
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
            self._linearized = kept
        return kept

    def states_between(self, T_states: Array, v_states: Array) -> StatesBetween:
        """Return states at the measurements' times; those of the graph may have moved since."""
        at = self._linearized or self.linearized(T_states, v_states)
        moved = StatesBetween.moved_by(at.T_states, at.v_states, T_states, v_states)
        qc_root = np.zeros(6) if self.qc_root is None else self.qc_root
        states = self.between.t, T_states, v_states
        return StatesBetween.given(
            at.system, at.bridges, moved, np.unique(self.t), qc_root, *states
        )

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
        covariance: Array,
    ) -> Array:
        """Return squared Mahalanobis distances (n,) of other measurements from their prediction."""
        at, distance = self.linearized(T_states, v_states), np.full(len(t), np.nan)
        if not len(at.system.known):
            return distance
        of = np.minimum(np.searchsorted(self.landmarks.number, number), len(at.system.known) - 1)
        known = (self.landmarks.number[of] == number) & (at.system.known[of] > 0)
        if not known.any():
            return distance
        order, between = np.flatnonzero(known), self.between.at(t)
        rows, by_landmark = measurement_rows_kernel(
            T_states,
            v_states,
            order,
            between.first,
            between.a,
            between.b,
            between.poses(T_states, v_states),
            of,
            at.fit.charts,
            at.fit.coordinates,
            measured,
            self.landmarks.camera,
            self.landmarks.whitening,
            np.ones(len(t)),
        )
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
        prior, prior_of = self.prior, self.landmarks.prior_of
        rows = prior.at(T_first, v_first)
        by_landmark = np.empty((len(prior), 3, 3))
        prior_system_kernel(
            T_first,
            fit.charts,
            fit.coordinates,
            prior_of,
            prior.seen,
            prior.root,
            rows,
            by_landmark,
        )
        return rows, by_landmark, np.flatnonzero(prior_of >= 0)


def _checked_landmarks(landmarks: ArrayLike, count: int) -> Index:
    """(count,) integers."""
    number = np.asarray(landmarks)
    if number.dtype.kind not in "iu" or number.shape not in ((), (count,)):
        raise ValueError(f"landmarks must be one integer or {count}, not {number}")
    return np.broadcast_to(number, (count,)).astype(np.int64)


def _diagonal(qc: ArrayLike) -> Array:
    """(6,) diagonal of a power spectral density that has no other entries."""
    matrix = power_spectral_density(qc)
    if np.count_nonzero(matrix - np.diag(np.diag(matrix))):
        raise ValueError("qc must be diagonal here")
    return np.diag(matrix)
