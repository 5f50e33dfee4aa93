"""All measurements of one landmark, each at its own time, in one factor without the landmark.

The landmark that fits the measurements best is found anew wherever the factor is evaluated, and the
errors are projected onto what no shift of the landmark can explain: the null space of its Jacobian
(Golub and Pereyra's variable projection; Mourikis and Roumeliotis, "A multi-state constraint Kalman
filter"). The gradient of the squared error is then exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array, checked_noise, power_spectral_density
from factors.kernels import Array
from factors.stereo import StereoCamera
from factors.tracklet_kernels import (
    eliminate_kernel,
    landmark_kernel,
    placed_kernel,
    poses_kernel,
    rows_kernel,
    states_rows_kernel,
)

_MAX_STEPS = 50
_TOLERANCE = 1e-8  # of the landmark's distance


class TrackletFactor(gtsam.CustomFactor):
    """Stereo measurements of one landmark at their own times, the landmark eliminated.

    Parameters
    ----------
    measured
        (n, 3) measurements (u_left, v, disparity) in rectified pixels, n >= 2.
    times
        (n,) their times in seconds, ascending.
    model
        Noise model of one measurement, dimension 3. A robust one weights each measurement by
        itself, by the norm of its whitened error.
    states
        (pose key, velocity key, time) in order of time: Pose3 T_world_cam, body twist (6,) with the
        rotation first, seconds. The factor takes those that bracket a measurement.
    camera
        Intrinsics of the rectified pair.
    qc
        Power spectral density, only checked: that of all times scales out of the mean.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, times are out of order or outside the
        states, or a disparity is not positive.

    Notes
    -----
    While the landmark is behind one of the cameras, that measurement has GTSAM's large constant
    error and no derivative.
    """

    def __init__(
        self,
        measured: ArrayLike,
        times: ArrayLike,
        model: gtsam.noiseModel.Base,
        states: Sequence[tuple[int, int, float]],
        camera: StereoCamera,
        qc: ArrayLike | None = None,
    ) -> None:
        if qc is not None:
            power_spectral_density(qc)
        measurements = checked_measurements(measured)
        checked_noise(model, 3)
        self._tracklet = tracklet = _Tracklet(measurements, camera, model, times, states)
        keys = [key for pose, velocity, _ in tracklet.states for key in (pose, velocity)]
        dimension = 3 * len(measurements) - 3
        super().__init__(gtsam.noiseModel.Unit.Create(dimension), keys, tracklet.error)

    def landmark(self, values: gtsam.Values) -> Array:
        """(3,) point in the world that fits the measurements best, given the states."""
        tracklet = self._tracklet
        T_states, v_states = tracklet.read(values)
        return tracklet.fit(
            poses_kernel(T_states, v_states, tracklet.first, tracklet.a, tracklet.b)
        )[0]


def checked_measurements(measured: ArrayLike) -> Array:
    """(n, 3) finite (u_left, v, disparity) with positive disparities, n >= 2."""
    measurements = checked_array("measured", measured, (3,))
    if measurements.ndim != 2 or len(measurements) < 2:
        raise ValueError(f"measured must have the shape (n, 3), n >= 2, not {measurements.shape}")
    if not (measurements[:, 2] > 0).all():
        raise ValueError("measured must have positive disparities: points before the camera")
    return measurements


def brackets(
    times: ArrayLike, states: Sequence[tuple[int, int, float]], count: int
) -> tuple[list[tuple[int, int, float]], NDArray[np.int64], Array, Array]:
    """The states that bracket a time; for each time the first of its two, and seconds from both."""
    t = checked_array("times", times, ())
    t_states = checked_array("states", [time for _, _, time in states], ())
    if t.shape != (count,):
        raise ValueError(f"times must have one entry for each of {count} measurements")
    if (np.diff(t) < 0).any():
        raise ValueError("times must be in order")
    if len(t_states) < 2 or (np.diff(t_states) <= 0).any():
        raise ValueError("states must be two or more in order of time")
    if t[0] < t_states[0] or t[-1] > t_states[-1]:
        raise ValueError(
            f"times from {t[0]} to {t[-1]} must lie between the states' {t_states[0]} and "
            f"{t_states[-1]}"
        )
    first = np.minimum(np.searchsorted(t_states, t, side="right"), len(t_states) - 1) - 1
    used = np.union1d(first, first + 1)
    a, b = t - t_states[first], t_states[first + 1] - t
    return [states[i] for i in used], np.searchsorted(used, first).astype(np.int64), a, b


class _Tracklet:
    """What a tracklet factor knows, and its error."""

    def __init__(
        self,
        measured: Array,
        camera: StereoCamera,
        model: gtsam.noiseModel.Base,
        times: ArrayLike,
        states: Sequence[tuple[int, int, float]],
    ) -> None:
        gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
        self.measured, self.camera = measured, camera.parameters
        self.whitening = np.ascontiguousarray(gaussian.Whiten(np.eye(3)))
        self.loss: Any = model.robust() if isinstance(model, gtsam.noiseModel.Robust) else None
        self.states, self.first, self.a, self.b = brackets(times, states, len(measured))
        self.nearest = int(np.argmax(measured[:, 2]))
        self.ones = np.ones(len(measured))
        self.nearest_point = camera.triangulate(measured[self.nearest])

    def error(
        self, _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        """(3n - 3,) projected errors, and their derivatives by each pose and velocity if asked."""
        T_states, v_states = self.read(values)
        T = poses_kernel(T_states, v_states, self.first, self.a, self.b)
        point, weights = self.fit(T)
        rows = self.rows(T, point, weights)
        if jacobians is None:
            matrix = np.ascontiguousarray(rows[:, 6:])
            eliminate_kernel(matrix)
            return self._with_loss(matrix[3:, 3], T, point)
        matrix = states_rows_kernel(T_states, v_states, self.first, self.a, self.b, rows)
        eliminate_kernel(matrix)
        for block in range(2 * len(self.states)):
            jacobians[block] = matrix[3:, 3 + 6 * block : 9 + 6 * block]
        return matrix[3:, -1]

    def read(self, values: gtsam.Values) -> tuple[Array, Array]:
        """Poses (m, 4, 4) and velocities (m, 6) of the states."""
        T_states, v_states = np.empty((len(self.states), 4, 4)), np.empty((len(self.states), 6))
        for i, (pose, velocity, _) in enumerate(self.states):
            T_states[i] = values.atPose3(pose).matrix()
            v_states[i] = values.atVector(velocity)
        return T_states, v_states

    def rows(self, T: Array, point: Array, weights: Array) -> Array:
        """(3n, 10) whitened and weighted derivatives by pose and landmark, and errors."""
        return rows_kernel(T, point, self.measured, self.camera, self.whitening, weights)

    def fit(self, T: Array) -> tuple[Array, Array]:
        """The landmark (3,) in the world that fits best, and the weights (n,) of the errors."""
        point, weights = placed_kernel(T, self.nearest, self.nearest_point), self.ones
        if self.loss is None:
            return self._step(T, point, weights, _MAX_STEPS), weights
        for _ in range(_MAX_STEPS):
            weights = np.array([np.sqrt(self.loss.weight(d)) for d in self._distances(T, point)])
            before, point = point, self._step(T, point, weights, 1)
            if np.abs(point - before).max() <= _TOLERANCE * np.abs(point - T[0, :3, 3]).max():
                break
        return point, weights

    def _step(self, T: Array, point: Array, weights: Array, steps: int) -> Array:
        return landmark_kernel(T, point, self.measured, self.camera, self.whitening, weights, steps)

    def _distances(self, T: Array, point: Array) -> Array:
        """(n,) norms of the whitened errors."""
        errors = self.rows(T, point, self.ones)[:, 9]
        return np.linalg.norm(errors.reshape(-1, 3), axis=1)

    def _with_loss(self, error: Array, T: Array, point: Array) -> Array:
        """The error scaled so that half its square is the robust loss of all measurements."""
        if self.loss is None:
            return error
        loss = sum(self.loss.loss(d) for d in self._distances(T, point))
        return error * np.sqrt(2 * loss / max(error @ error, np.finfo(float).tiny))
