"""All measurements of one landmark, each at its own time, in one factor without the landmark.

The landmark that fits the measurements best is found anew wherever the factor is evaluated, and the
errors are projected onto what no shift of the landmark can explain: the null space of its Jacobian
(Golub and Pereyra's variable projection; Mourikis and Roumeliotis, "A multi-state constraint Kalman
filter"). The gradient of the squared error is then exact.
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_noise, power_spectral_density
from factors.kernels import Array
from factors.stereo import StereoCamera
from factors.structureless.bracketing_states import BracketingStates, checked_times
from factors.structureless.fitted_landmarks import Landmarks, checked_measurements
from factors.structureless.tracklet_kernels import eliminate_kernel, rows_kernel, states_rows_kernel


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
        t = checked_times(times, len(measurements))
        if (np.diff(t) < 0).any():
            raise ValueError("times must be in order")
        between = BracketingStates(t, states)
        landmark = Landmarks(measurements, np.array([0, len(t)]), model, camera)
        self._tracklet = tracklet = _Tracklet(between, landmark)
        unit = gtsam.noiseModel.Unit.Create(3 * len(t) - 3)
        super().__init__(unit, between.keys, tracklet.error)

    def landmark(self, values: gtsam.Values) -> Array:
        """(3,) point in the world that fits the measurements best, given the states."""
        between, landmark = self._tracklet.between, self._tracklet.landmark
        return landmark.points(between.poses(*between.read(values)))[0]


class _Tracklet:
    """What a tracklet factor knows, and its error."""

    def __init__(self, between: BracketingStates, landmark: Landmarks) -> None:
        self.between, self.landmark = between, landmark

    def error(
        self, _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        """(3n - 3,) projected errors, and their derivatives by each pose and velocity if asked."""
        between, loss = self.between, self.landmark.loss
        T_states, v_states = between.read(values)
        T = between.poses(T_states, v_states)
        coordinates, distances = self.landmark.fit(T)
        weights = loss.weights(distances)
        rows = rows_kernel(T, coordinates, *self.landmark.measurements, weights)
        if jacobians is None:
            matrix = np.ascontiguousarray(rows[:, 6:])
            eliminate_kernel(matrix)
            error = matrix[3:, 3]
            squares = max(error @ error, np.finfo(float).tiny)
            return error * np.sqrt(2 * loss.total(distances) / squares)
        matrix = states_rows_kernel(T_states, v_states, between.first, between.a, between.b, rows)
        eliminate_kernel(matrix)
        for block in range(2 * len(between.states)):
            jacobians[block] = matrix[3:, 3 + 6 * block : 9 + 6 * block]
        return matrix[3:, -1]
