"""Landmarks seen from many poses, and where they fit what is measured of them best."""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array
from factors.kernels.se3 import Array
from factors.stereo import StereoCamera
from factors.structureless.identities import increasing
from factors.structureless.landmark_kernels import landmarks_kernel, nearest_kernel
from factors.structureless.landmark_prior import LandmarkPrior, points_of
from factors.structureless.robust_losses import Loss

_MAX_STEPS = 50
_MAX_REWEIGHTED = 1000  # each time closer by a share, which is small for some losses
_TOLERANCE = 1e-11  # of coordinates, in units of the focal length and of one over a metre


def checked_measurements(measured: ArrayLike) -> Array:
    """(n, 3) finite (u_left, v, disparity) with positive disparities."""
    measurements = checked_array("measured", measured, (3,))
    if measurements.ndim != 2:
        raise ValueError(f"measured must have the shape (n, 3), not {measurements.shape}")
    if not (measurements[:, 2] > 0).all():
        raise ValueError("measured must have positive disparities: points before the camera")
    return measurements


class Fit(NamedTuple):
    """Where landmarks fit best.

    Poses (n, 4, 4) at the measurements, coordinates (L, 3) in the charts (L, 4, 4), and the norms
    (n,) and the weights (n,) of the whitened errors there.
    """

    T: Array
    charts: Array
    coordinates: Array
    distances: Array
    weights: Array

    def points(self) -> Array:
        """(L, 3) points in the world."""
        return points_of(self.coordinates, self.charts)


class FittedLandmarks:
    """Landmarks of measurements that are in order of landmarks, and of a prior.

    Attributes
    ----------
    number
        (L,) increasing identities.
    of
        (n,) which of them each measurement is of.
    start
        (L + 1,): the k-th one is measured from start[k] to start[k + 1].
    prior, with_prior
        What is known of some, and which these are, (P,).
    measured, camera, whitening
        (n, 3) measurements, (5,) parameters, and the matrices (n, 3, 3) that whiten their errors.
    loss
        Of the norm of a whitened error.
    redundancy
        Number of measured values less that of the coordinates of the landmarks measured.
    """

    def __init__(
        self,
        measured: Array,
        number: NDArray[np.int64],
        model: gtsam.noiseModel.Base,
        camera: StereoCamera,
        prior: LandmarkPrior,
        deviations: Array,
    ) -> None:
        gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
        self._whitening = gaussian.Whiten(np.eye(3))
        self.whitening = self.whitening_of(deviations)
        self.loss, self.measured, self.camera = Loss(model), measured, camera.parameters
        self.number = increasing(number, prior.number)
        self.of = np.searchsorted(self.number, number)
        self.start = np.append(np.searchsorted(number, self.number), len(number))
        self.prior, self.with_prior = prior, np.searchsorted(self.number, prior.number)
        self._prior_of = np.full(len(self.number), -1)
        self._prior_of[self.with_prior] = np.arange(len(prior))
        self._measured = np.flatnonzero(np.diff(self.start))
        self.redundancy = 3 * (len(measured) - len(self._measured))
        self._nearest = nearest_kernel(self.start, measured)[self._measured]
        self._initial = np.empty((len(self.number), 3))
        self._initial[self._measured] = camera.inverse_depth(measured[self._nearest])
        self._initial[self.with_prior] = prior.seen

    def whitening_of(self, deviations: Array) -> Array:
        """Return the matrices (n, 3, 3) that whiten errors of deviations (n, 3), in the model's."""
        return np.ascontiguousarray(self._whitening / deviations[:, None])

    def fit(self, T: Array, T_first: Array, offset: Array) -> Fit:
        """Landmarks that fit best, T (n, 4, 4) the poses at the measurements.

        T_first (4, 4) is the pose at the first state, and `offset` (P, 3) the error of the prior
        where nothing deviates (see `LandmarkPrior.at`).
        """
        views = self.prior.views(T_first)
        charts = np.empty((len(self.number), 4, 4))
        charts[self._measured] = T[self._nearest]
        charts[self.with_prior] = views
        ones = np.ones(len(T))
        if self.loss.other is None:
            found = self._stepped(T, charts, self._initial, views, offset, ones, _MAX_STEPS)
            return Fit(T, charts, *found, self.loss.weights(found[1]))
        found = self._stepped(T, charts, self._initial, views, offset, ones, 0)
        for _ in range(_MAX_REWEIGHTED):
            before, weights = found[0], self.loss.weights(found[1])
            found = self._stepped(T, charts, before, views, offset, weights, 1)
            if np.abs(found[0] - before).max(initial=0.0) <= _TOLERANCE:
                break
        return Fit(T, charts, *found, self.loss.weights(found[1]))

    def _stepped(
        self,
        T: Array,
        charts: Array,
        coordinates: Array,
        views: Array,
        offset: Array,
        weights: Array,
        steps: int,
    ) -> tuple[Array, Array]:
        measured = self.start, self.measured, self.camera, self.whitening, weights
        known = views, self._prior_of, self.prior.seen, self.prior.root, offset
        return landmarks_kernel(
            T, charts, coordinates, *measured, self.loss.parameters, *known, steps
        )
