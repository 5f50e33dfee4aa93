"""Measurements of many landmarks, each at its own time, in one factor without the landmarks.

What `TrackletFactor` is for one landmark: all are eliminated where the factor is evaluated, and
what they tell of the states is compressed to as many rows as the states have columns. GTSAM then
sees a chain of states alone, however many landmarks there are (structureless factors: Carlone et
al., "Eliminating conditionally independent sets in factor graphs", 2014).
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
from factors.structureless_kernels import (
    errors_kernel,
    information_kernel,
    landmarks_kernel,
    poses_between_kernel,
    root_kernel,
)
from factors.tracklet import brackets, checked_measurements

_MAX_STEPS = 50
_TOLERANCE = 1e-8  # of coordinates, in units of the focal length and of one over a metre


class StructurelessStereoFactor(gtsam.CustomFactor):
    """Stereo measurements of many landmarks at their own times, the landmarks eliminated.

    Parameters
    ----------
    measured
        (n, 3) measurements (u_left, v, disparity) in rectified pixels, n >= 2.
    times
        (n,) their times in seconds.
    landmarks
        (n,) integers: measurements of equal ones are of the same landmark. A landmark that is
        measured once tells nothing.
    model, states, camera, qc
        As of `TrackletFactor`.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, times lie outside the states, or a
        disparity is not positive.

    Notes
    -----
    Its errors are 12 for each state and one more; half their squared norm is the cost of all
    measurements, and the derivative gives its exact gradient. While a landmark is behind one of the
    cameras, that measurement has GTSAM's large constant error and no derivative.
    """

    def __init__(
        self,
        measured: ArrayLike,
        times: ArrayLike,
        landmarks: ArrayLike,
        model: gtsam.noiseModel.Base,
        states: Sequence[tuple[int, int, float]],
        camera: StereoCamera,
        qc: ArrayLike | None = None,
    ) -> None:
        if qc is not None:
            power_spectral_density(qc)
        measurements = checked_measurements(measured)
        number = np.asarray(landmarks)
        if number.shape != (len(measurements),) or number.dtype.kind not in "iu":
            raise ValueError(f"landmarks must be {len(measurements)} integers")
        checked_noise(model, 3)
        self._tracklets = found = _Tracklets(measurements, times, number, model, states, camera)
        keys = [key for pose, velocity, _ in found.states for key in (pose, velocity)]
        unit = gtsam.noiseModel.Unit.Create(12 * len(found.states) + 1)
        super().__init__(unit, keys, found.error)

    def landmarks(self, values: gtsam.Values) -> tuple[NDArray[np.int64], Array]:
        """(L,) increasing landmarks, and the (L, 3) points in the world that fit them best."""
        found = self._tracklets
        T = found.poses(*found.read(values))
        x, y, inverse_depth = found.fit(T)[0].T
        local = np.column_stack([x, y, np.ones(len(x))]) / inverse_depth[:, None]
        chart = T[found.nearest]
        return found.number, np.einsum("kij,kj->ki", chart[:, :3, :3], local) + chart[:, :3, 3]


class _Tracklets:
    """What the factor knows, in order of landmarks and times, and its error."""

    def __init__(
        self,
        measured: Array,
        times: ArrayLike,
        number: NDArray[np.int64],
        model: gtsam.noiseModel.Base,
        states: Sequence[tuple[int, int, float]],
        camera: StereoCamera,
    ) -> None:
        t = checked_array("times", times, ())
        if t.shape != number.shape:
            raise ValueError(f"times must have one entry for each of {len(number)} measurements")
        in_time = np.argsort(t, kind="stable")
        self.states, *between = brackets(t[in_time], states, len(measured))
        by_landmark = np.argsort(number[in_time], kind="stable")
        self.first, self.a, self.b = (part[by_landmark] for part in between)
        order = in_time[by_landmark]
        self.measured, self.camera = np.ascontiguousarray(measured[order]), camera.parameters
        self.number, start = np.unique(number[order], return_index=True)
        self.start = np.append(start, len(order)).astype(np.int64)
        gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
        self.whitening = np.ascontiguousarray(gaussian.Whiten(np.eye(3)))
        self.loss: Any = model.robust() if isinstance(model, gtsam.noiseModel.Robust) else None
        nearest_last = np.lexsort((self.measured[:, 2], number[order]))
        self.nearest = nearest_last[self.start[1:] - 1]
        self.seen = camera.inverse_depth(self.measured[self.nearest])
        self.linearized = np.empty(0), np.empty(0), np.empty(0)

    def error(
        self, _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        """(12 m + 1,) errors, and their derivatives by each pose and velocity if asked."""
        T_states, v_states = self.read(values)
        if jacobians is None:
            error = np.zeros(12 * len(self.states) + 1)
            error[-1] = np.sqrt(2 * self._cost(self.poses(T_states, v_states)))
            return error
        # iSAM2 linearizes a new factor twice at the same values.
        same = np.array_equal(T_states, self.linearized[0])
        if not (same and np.array_equal(v_states, self.linearized[1])):
            self.linearized = T_states, v_states, self._root(T_states, v_states)
        root = self.linearized[2]
        for block in range(2 * len(self.states)):
            jacobians[block] = root[:, 6 * block : 6 * block + 6]
        return root[:, -1]

    def _root(self, T_states: Array, v_states: Array) -> Array:
        """(12 m + 1, 12 m + 1) derivatives by the states, then the errors."""
        T = self.poses(T_states, v_states)
        coordinates, weights = self.fit(T)
        between = T_states, v_states, self.first, self.a, self.b, T
        landmarks = T[self.nearest], coordinates, *self._measurements, weights
        return root_kernel(*information_kernel(*between, *landmarks))

    def read(self, values: gtsam.Values) -> tuple[Array, Array]:
        """Poses (m, 4, 4) and velocities (m, 6) of the states."""
        T_states, v_states = np.empty((len(self.states), 4, 4)), np.empty((len(self.states), 6))
        for i, (pose, velocity, _) in enumerate(self.states):
            T_states[i] = values.atPose3(pose).matrix()
            v_states[i] = values.atVector(velocity)
        return T_states, v_states

    def poses(self, T_states: Array, v_states: Array) -> Array:
        """(n, 4, 4) poses at the measurements."""
        return poses_between_kernel(T_states, v_states, self.first, self.a, self.b)

    def fit(self, T: Array) -> tuple[Array, Array]:
        """The landmarks (L, 3) that fit best, and the weights (n,) of the errors.

        Their coordinates are x / z, y / z and 1 / z in the frame of their nearest measurement.
        """
        coordinates, weights = self.seen, np.ones(len(T))
        if self.loss is None:
            return self._step(T, coordinates, weights, _MAX_STEPS), weights
        for _ in range(_MAX_STEPS):
            distances = self._distances(T, coordinates)
            weights = np.array([np.sqrt(self.loss.weight(d)) for d in distances])
            before, coordinates = coordinates, self._step(T, coordinates, weights, 1)
            if np.abs(coordinates - before).max() <= _TOLERANCE:
                break
        return coordinates, weights

    @property
    def _measurements(self) -> tuple[NDArray[np.int64], Array, Array, Array]:
        return self.start, self.measured, self.camera, self.whitening

    def _step(self, T: Array, coordinates: Array, weights: Array, steps: int) -> Array:
        charts = T[self.nearest]
        return landmarks_kernel(T, charts, coordinates, *self._measurements, weights, steps)

    def _distances(self, T: Array, coordinates: Array) -> Array:
        """(n,) norms of the whitened errors."""
        errors = errors_kernel(T, T[self.nearest], coordinates, *self._measurements)
        return np.linalg.norm(errors, axis=1)

    def _cost(self, T: Array) -> float:
        """Half the sum of squares, or the loss, of all measurements."""
        distances = self._distances(T, self.fit(T)[0])
        if self.loss is None:
            return 0.5 * float(distances @ distances)
        return float(sum(self.loss.loss(d) for d in distances))
