"""Landmarks seen from many poses, and where they fit what is measured of them best."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array
from factors.kernels import Array
from factors.landmark_kernels import distances_kernel, landmarks_kernel
from factors.losses import Loss
from factors.stereo import StereoCamera

_MAX_STEPS = 50
_TOLERANCE = 1e-8  # of coordinates, in units of the focal length and of one over a metre


def checked_measurements(measured: ArrayLike) -> Array:
    """(n, 3) finite (u_left, v, disparity) with positive disparities, n >= 2."""
    measurements = checked_array("measured", measured, (3,))
    if measurements.ndim != 2 or len(measurements) < 2:
        raise ValueError(f"measured must have the shape (n, 3), n >= 2, not {measurements.shape}")
    if not (measurements[:, 2] > 0).all():
        raise ValueError("measured must have positive disparities: points before the camera")
    return measurements


class Landmarks:
    """Landmarks by their coordinates (x / z, y / z, 1 / z) where they were measured nearest.

    The k-th one is measured from start[k] to start[k + 1].
    """

    def __init__(
        self,
        measured: Array,
        start: NDArray[np.int64],
        model: gtsam.noiseModel.Base,
        camera: StereoCamera,
    ) -> None:
        gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
        whitening = np.ascontiguousarray(gaussian.Whiten(np.eye(3)))
        self.measurements = start, measured, camera.parameters, whitening
        self.loss = Loss(model)
        nearest_last = np.lexsort(
            (measured[:, 2], np.repeat(np.arange(len(start) - 1), np.diff(start)))
        )
        self._nearest = nearest_last[start[1:] - 1]
        self._seen = camera.inverse_depth(measured[self._nearest])

    def charts(self, T: Array) -> Array:
        """(L, 4, 4) poses that the coordinates are of, of those (n, 4, 4) at the measurements."""
        return T[self._nearest]

    def fit(self, T: Array) -> tuple[Array, Array]:
        """Coordinates (L, 3) that fit best, and the norms (n,) of the whitened errors there."""
        coordinates, steps = self._seen, 1 if self.loss.other else _MAX_STEPS
        distances = self._distances(T, coordinates)
        for _ in range(_MAX_STEPS):
            before, weights = coordinates, self.loss.fixed_weights(distances)
            coordinates = landmarks_kernel(
                T, self.charts(T), before, *self.measurements, weights, self.loss.parameters, steps
            )
            distances = self._distances(T, coordinates)
            if steps > 1 or np.abs(coordinates - before).max() <= _TOLERANCE:
                break
        return coordinates, distances

    def points(self, T: Array) -> Array:
        """(L, 3) points in the world that fit best."""
        x, y, inverse_depth = self.fit(T)[0].T
        local = np.column_stack([x, y, np.ones(len(x))]) / inverse_depth[:, None]
        chart = self.charts(T)
        return np.einsum("kij,kj->ki", chart[:, :3, :3], local) + chart[:, :3, 3]

    def _distances(self, T: Array, coordinates: Array) -> Array:
        return distances_kernel(T, self.charts(T), coordinates, *self.measurements)
