"""Measurements of many landmarks, each at its own time, in one factor without the landmarks.

All landmarks are eliminated where the factor is evaluated, and what they tell of the states is
compressed to as many rows as the states have columns. GTSAM then sees a chain of states alone,
however many landmarks there are (structureless factors: Carlone et al., "Eliminating conditionally
independent sets in factor graphs", 2014). With Q_c, the states at the measurements' own times are
eliminated, too (`Bridge`), and a prior carries what earlier measurements know of the landmarks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import (
    Pose,
    checked_array,
    checked_finite_noise,
    checked_number,
    power_spectral_density,
)
from factors.factor import Factor
from factors.kernels.se3 import Array
from factors.mounting import checked_mounting
from factors.stereo import Camera, StereoMeasurements, as_camera, stereo_measurements
from factors.structureless.bracketing_states import BracketingStates, checked_times
from factors.structureless.fitted_landmarks import FittedLandmarks, checked_measurements
from factors.structureless.identities import are_in, increasing
from factors.structureless.landmark_prior import LandmarkPrior, points_of
from factors.structureless.landmark_window import LandmarkWindow
from factors.structureless.states_between import StatesBetween
from factors.variables import State, as_state

Index = NDArray[np.int64]

TOLERANCE = 1e-3
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
    deviations
        (n, 3) standard deviations of u_left, v and disparity, as multiples of the model's: a match
        is as precise as its patch has gradients. One by default.

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
    Landmarks that are known and not measured fit their prior whatever the states are, and tell
    nothing of these: they are `resting`, a prior of its own.
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
        deviations: ArrayLike | None = None,
    ) -> None:
        roots = None if qc is None else np.sqrt(_diagonal(qc))
        made_of = _checked(
            *(measured, times, landmarks, model, states, camera),
            *(qc, prior, tolerance, T_body_cam, deviations),
        )
        t, number, each = made_of["times"], made_of["landmarks"], made_of["deviations"]
        order = self._order = np.lexsort((t, number))
        each = np.ones((len(t), 3)) if each is None else each[order]
        seen = made_of["measured"][order], number[order], made_of["model"], made_of["camera"]
        every, mount = not (qc is None and prior is None), made_of["T_body_cam"]
        between = BracketingStates(t[order], made_of["states"], every, mount)
        known = LandmarkPrior.none() if prior is None else prior

        def window_with(resting: Index) -> LandmarkWindow:
            of = known.only(are_in(increasing(number, resting), known.number))
            fitted = FittedLandmarks(*seen, of, each)
            return LandmarkWindow(between, t[order], fitted, roots, made_of["tolerance"])

        self._window_with = window_with
        self.window = window = window_with(np.empty(0, np.int64))
        self.resting = known.only(~are_in(window.landmarks.number, known.number))
        unit = gtsam.noiseModel.Unit.Create(window.size)
        super().__init__(unit, between.variables, window.error, made_of)

    def landmarks(self, values: gtsam.Values) -> tuple[Index, Array]:
        """Return (L,) increasing landmarks and the (L, 3) points in the world that fit best.

        One whose rays diverge fits best beyond infinity: a point behind the cameras.
        """
        T_states, v_states = self.window.between.read(values)
        number, resting = self.landmark_numbers, self.resting
        points, rests = np.empty((len(number), 3)), are_in(resting.number, number)
        points[~rests] = self.window.fit(T_states, v_states).points()
        coordinates = resting.without_error(resting.at(T_states[0], v_states[0]))
        points[rests] = points_of(coordinates, resting.views(T_states[0]))
        return number, points

    @property
    def landmark_numbers(self) -> Index:
        """Landmarks (L,), increasing, those of the prior as well."""
        return increasing(self.window.landmarks.number, self.resting.number)

    @property
    def redundancy(self) -> int:
        """Number of measured values less that of the coordinates of the landmarks measured."""
        return self.window.landmarks.redundancy

    def states_between(self, values: gtsam.Values) -> StatesBetween:
        """Return the states at the measurements' own times, given those of the graph.

        By the latest linearisation, if there was one: the states may have moved a little since.
        """
        return self.window.states_between(*self.window.between.read(values))

    def residuals(self, values: gtsam.Values) -> Array:
        """Return the errors (n, 3) of the measurements, predicted less measured, pixels."""
        return self.window.residuals(*self.window.between.read(values))[np.argsort(self._order)]

    def squared_distances(
        self,
        values: gtsam.Values,
        measured: ArrayLike,
        times: ArrayLike,
        landmarks: ArrayLike,
        covariance: Array,
        deviations: ArrayLike | None = None,
    ) -> Array:
        """Return squared Mahalanobis distances (n,) of new measurements from their prediction.

        `covariance` (12 m, 12 m) is that of the states, given all but the new measurements. The
        distance of a landmark that the factor does not know is not a number. Deviations (n, 3) are
        those of the factor's own measurements.
        """
        measurements = checked_measurements(measured)
        t = checked_times(times, len(measurements))
        number = _checked_landmarks(landmarks, len(t))
        rests = are_in(self.resting.number, number).any()
        window = self._window_with(number) if rests else self.window
        states = window.between.read(values)
        size = 12 * len(states[0])
        if np.shape(covariance) != (size, size):
            raise ValueError(f"covariance must be ({size}, {size}), not {np.shape(covariance)}")
        by_body = window.between.by_body
        if by_body is not None:
            by_bodies = np.kron(np.eye(size // 6), by_body)
            covariance = by_bodies @ covariance @ by_bodies.T
        each = _checked_deviations(deviations, len(t))
        new = *states, measurements, t, number, each, covariance
        return window.squared_distances(*new)


def _checked(
    measured: StereoMeasurements,
    times: ArrayLike,
    landmarks: ArrayLike,
    model: gtsam.noiseModel.Base,
    states: Sequence[State],
    camera: Camera,
    qc: ArrayLike | None,
    prior: LandmarkPrior | None,
    tolerance: float,
    T_body_cam: Pose | None,
    deviations: ArrayLike | None,
) -> dict[str, Any]:
    """Check the arguments of a factor of many landmarks."""
    measurements, model = stereo_measurements(measured, model)
    measurements = checked_measurements(measurements)
    t = checked_times(times, len(measurements))
    checked_finite_noise(model, 3)
    if prior is None and len(t) < 2:
        raise ValueError(f"measured must have two rows or more, not {len(t)}")
    if not (prior is None or isinstance(prior, LandmarkPrior)):
        raise ValueError(f"prior must be a LandmarkPrior, not {type(prior).__name__}")
    if T_body_cam is not None and not (qc is None and prior is None):
        raise ValueError("T_body_cam must not be given with qc or prior: these are the camera's")
    return {
        "measured": measurements,
        "times": t,
        "landmarks": _checked_landmarks(landmarks, len(t)),
        "model": model,
        "states": [as_state("states", state) for state in states],
        "camera": as_camera(camera),
        "qc": None if qc is None else np.array(qc, np.float64),
        "prior": prior,
        "tolerance": _checked_tolerance(tolerance),
        "T_body_cam": checked_mounting(T_body_cam),
        "deviations": None if deviations is None else _checked_deviations(deviations, len(t)),
    }


def _checked_tolerance(tolerance: float) -> float:
    """Return a finite number that is not negative."""
    tolerance = checked_number("tolerance", tolerance)
    if tolerance < 0:
        raise ValueError(f"tolerance must not be negative, not {tolerance}")
    return tolerance


def _checked_landmarks(landmarks: ArrayLike, count: int) -> Index:
    """(count,) integers."""
    number = np.asarray(landmarks)
    integers = number.dtype.kind in "iu" or not number.size
    if not integers or number.shape not in ((), (count,)):
        raise ValueError(f"landmarks must be one integer or {count}, not {number}")
    return np.broadcast_to(number, (count,)).astype(np.int64)


def _checked_deviations(deviations: ArrayLike | None, count: int) -> Array:
    """(count, 3) positive numbers, one by default."""
    if deviations is None:
        return np.ones((count, 3))
    found = checked_array("deviations", deviations, (3,))
    if found.shape != (count, 3) or not (found > 0).all():
        raise ValueError(f"deviations must be ({count}, 3) positive numbers")
    return found


def _diagonal(qc: ArrayLike) -> Array:
    """(6,) diagonal of a power spectral density that has no other entries."""
    matrix = power_spectral_density(qc)
    if np.count_nonzero(matrix - np.diag(np.diag(matrix))):
        raise ValueError("qc must be diagonal here")
    return np.diag(matrix)
