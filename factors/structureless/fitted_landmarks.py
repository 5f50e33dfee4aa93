"""Landmarks seen from many poses, and where they fit what is measured of them best."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array
from factors.kernels import Array
from factors.stereo import StereoCamera
from factors.structureless.landmark_kernels import landmarks_kernel
from factors.structureless.robust_losses import Loss

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

    Attributes
    ----------
    measurements
        For the kernels: the nearest measurement (L,) of each landmark, start, measured, the
        camera's parameters, and the matrix (3, 3) that whitens an error.
    loss
        Of the norm of a whitened error.
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
        self.loss = Loss(model)
        of = np.repeat(np.arange(len(start) - 1), np.diff(start))
        nearest = np.lexsort((measured[:, 2], of))[start[1:] - 1]
        self._seen = camera.inverse_depth(measured[nearest])
        self.measurements = nearest, start, measured, camera.parameters, whitening

    def fit(self, T: Array) -> tuple[Array, Array]:
        """Coordinates (L, 3) that fit best, and the norms (n,) of the whitened errors there.

        T (n, 4, 4) are the poses at the measurements.
        """
        ones = np.ones(len(T))
        if self.loss.other is None:
            return self._stepped(T, self._seen, ones, _MAX_STEPS)
        coordinates, distances = self._stepped(T, self._seen, ones, 0)
        for _ in range(_MAX_STEPS):
            before, weights = coordinates, self.loss.weights(distances)
            coordinates, distances = self._stepped(T, before, weights, 1)
            if np.abs(coordinates - before).max() <= _TOLERANCE:
                break
        return coordinates, distances

    def points(self, T: Array) -> Array:
        """(L, 3) points in the world that fit best."""
        x, y, inverse_depth = self.fit(T)[0].T
        local = np.column_stack([x, y, np.ones(len(x))]) / inverse_depth[:, None]
        chart = T[self.measurements[0]]
        return np.einsum("kij,kj->ki", chart[:, :3, :3], local) + chart[:, :3, 3]

    def _stepped(
        self, T: Array, coordinates: Array, weights: Array, steps: int
    ) -> tuple[Array, Array]:
        return landmarks_kernel(
            T, coordinates, *self.measurements, weights, self.loss.parameters, steps
        )
