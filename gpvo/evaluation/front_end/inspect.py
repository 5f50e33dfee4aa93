"""Comparison of every stage of the front end with the truth, for `gpvo inspect`.

It covers features, quad matches, tracklets with their image motion, disparities and times, and
MC-RANSAC.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.stereo import StereoCamera
from gpvo.array_table import ArrayTable
from gpvo.config import Configuration, in_full_pixels
from gpvo.errors import InputError
from gpvo.estimator import GatheredMeasurements, make_estimator, one_blas_thread
from gpvo.evaluation.front_end.truth import Truth
from gpvo.events import StereoCluster
from gpvo.front_end import FrontEnd, TrackedCluster
from gpvo.mc_ransac import Segments, fast_mc_ransac, segments_between
from gpvo.recordings import Recording
from gpvo.tracking import Measurements

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AGREEMENT = 2.0
"""Largest error norm (u, v, disparity) of a tracklet that agrees with the true motion, pixels."""
SLOPE_AGREEMENT = 3.0
"""The same for the slope of measured on true flow; wider, so that selection does not bias it."""
SLOWEST = 20.0
"""Slowest image motion for which a position error gives a time error, pixels per second."""


@dataclass(frozen=True, eq=False)
class JudgedTracklets(ArrayTable):
    """N tracklets, each from its first measurement in MC-RANSAC's span to the newest cluster.

    Attributes
    ----------
    earlier, later
        Measurements at their two ends.
    accepted
        (N,) bool, MC-RANSAC's inliers.
    error
        (N, 3) measured minus true (u_left, v, disparity) of the later end, pixels. The true one
        follows from the earlier end, its true depth if known, and the true motion. NaN without
        truth.
    disparity_error
        (N,) measured minus true disparity of the later end, pixels.
    time_error
        (N,) measured minus true time of the later end, given the earlier one's time, seconds: minus
        the position error along the true image motion, divided by its speed. NaN if that is slow.
    """

    earlier: Measurements
    later: Measurements
    accepted: Mask
    error: Array
    disparity_error: Array
    time_error: Array

    @property
    def has_truth(self) -> Mask:
        """(N,) bool, tracklets of which the error is known."""
        return np.isfinite(self.error[:, 0])

    @property
    def distance(self) -> Array:
        """(N,) norm of the error, pixels; infinite where it is unknown."""
        return np.nan_to_num(np.linalg.norm(self.error, axis=1), nan=np.inf)

    @property
    def agree(self) -> Mask:
        """(N,) bool, tracklets that agree with the true motion."""
        return self.distance <= AGREEMENT

    @property
    def measured_flow(self) -> Array:
        """(N, 2) measured motion of the left image point, pixels."""
        return (self.later.stereo - self.earlier.stereo)[:, :2]

    @property
    def true_flow(self) -> Array:
        """(N, 2) true motion of the left image point, pixels."""
        return self.measured_flow - self.error[:, :2]

    @property
    def duration(self) -> Array:
        """(N,) time between the two ends, seconds."""
        return self.later.t - self.earlier.t


@dataclass(frozen=True, eq=False)
class InspectedCluster:
    """Results of every stage for one cluster.

    Attributes
    ----------
    start, stop
        Seconds since the recording's start.
    events, features, quads
        Numbers of events of both cameras, of features of the cluster before, and of those of them
        that are matched around the quad.
    tracklets
        Tracklets that pass the filters.
    true_twist, fast_twist, iterative_twist
        (6,) mean body twist over the tracklets, rotation first, rad/s and m/s: true, and estimated
        by both versions of MC-RANSAC. NaN where unknown.
    picture
        Left binary frame, packed bits.
    """

    start: float
    stop: float
    events: int
    features: int
    quads: int
    tracklets: JudgedTracklets
    true_twist: Array
    fast_twist: Array
    iterative_twist: Array
    picture: NDArray[np.uint8]


def inspect(
    recording: Recording,
    truth: Truth,
    configuration: Configuration,
    start: float = 0.0,
    duration: float = np.inf,
    progress: Callable[[InspectedCluster], None] | None = None,
) -> list[InspectedCluster]:
    """Run the front end over a part of a recording and compare every cluster with the truth.

    Raises
    ------
    InputError
        If the events are faulty, there are too few for a cluster, or the truth covers too little.
    """
    inspector = _Inspector(recording, truth, configuration)
    batches = recording.event_batches(start, start + duration)
    clusters = []
    for cluster in inspector.front_end.clustering.clusters(batches):
        clusters.append(inspector.process(cluster))
        if progress is not None:
            progress(clusters[-1])
    if not clusters:
        raise InputError(f"{recording.path}: too few events for a cluster")
    _check_coverage(clusters, truth)
    return clusters


def _check_coverage(clusters: Sequence[InspectedCluster], truth: Truth) -> None:
    """Raise InputError if most tracklets have no truth: medians would tell nothing."""
    known = sum(int(one.tracklets.has_truth.sum()) for one in clusters)
    if known < 0.5 * sum(len(one.tracklets) for one in clusters):
        raise InputError(
            f"{truth.name}: its poses, from {truth.start:.3f} to {truth.stop:.3f} s of the"
            " recording, cover less than half of the tracklets; choose what they cover by --start"
            " and --duration, or give another --ground-truth"
        )


class _Inspector:
    """Front end, the estimator that tells it poses, and the truth that it is compared with."""

    def __init__(self, recording: Recording, truth: Truth, configuration: Configuration) -> None:
        self.front_end = FrontEnd(recording.rig, configuration)
        self._truth = truth
        self._config = in_full_pixels(self.front_end.configuration).mc_ransac
        config = self.front_end.configuration.estimator
        self._estimator = make_estimator(self.front_end.camera, self.front_end.noise, config)
        self._measurements = GatheredMeasurements(self._estimator, config)

    def process(self, cluster: StereoCluster) -> InspectedCluster:
        rng = deepcopy(self.front_end.rng)
        tracked = self.front_end.process(cluster)
        earlier, later, estimate = tracked.earlier, tracked.later, tracked.velocity_estimate
        self._estimate(cluster, tracked)
        return InspectedCluster(
            cluster.start,
            cluster.stop,
            cluster.event_count,
            tracked.tracking.known if tracked.tracking else 0,
            tracked.tracking.closed if tracked.tracking else 0,
            judge(earlier, later, tracked.inliers, self._truth, self.front_end.camera),
            self._true_twist(earlier, later),
            self._fast_twist(segments_between(earlier, later), rng),
            np.full(6, np.nan) if estimate is None else estimate.velocity,
            np.packbits(cluster.left.binary_frame > 0, axis=1),
        )

    def _estimate(self, cluster: StereoCluster, tracked: TrackedCluster) -> None:
        """Estimate in the order of the odometry, which tracks a cluster beside the one before."""
        self.front_end.tell_estimate(self._estimator.latest())
        with one_blas_thread():
            self._measurements.add(cluster.stop, tracked.measurements, tracked.velocity_estimate)

    def _fast_twist(self, segments: Segments, rng: np.random.Generator) -> Array:
        """Return the twist of the fast version alone, from the same samples as the whole."""
        if len(segments) < self._config.sample_size:
            return np.full(6, np.nan)
        return fast_mc_ransac(segments, self.front_end.camera, self._config, rng)

    def _true_twist(self, earlier: Measurements, later: Measurements) -> Array:
        if len(later) == 0:
            return np.full(6, np.nan)
        start, stop = float(np.median(earlier.t)), float(np.median(later.t))
        if not self._truth.start <= start < stop <= self._truth.stop:
            return np.full(6, np.nan)
        return self._truth.mean_twist(start, stop)


def judge(
    earlier: Measurements,
    later: Measurements,
    accepted: Mask,
    truth: Truth,
    camera: StereoCamera,
) -> JudgedTracklets:
    """Compute the errors of tracklets (N,) from the true motion and depth."""
    known = (earlier.t >= truth.start) & (later.t <= truth.stop)
    error = np.full((len(later), 3), np.nan)
    disparity_error, time_error = (np.full(len(later), np.nan) for _ in range(2))
    if known.any():
        first, last = earlier[known], later[known]
        points = truth.points(first, camera)
        error[known] = last.stereo - truth.projection(points, last.t, camera)
        disparity_error[known] = (
            error[known, 2]
            if truth.depth is None
            else last.stereo[:, 2] - truth.disparity(last, camera)
        )
        velocity = truth.image_velocity(points, last.t, camera)
        speed = np.linalg.norm(velocity, axis=1)
        along = np.einsum("ni,ni->n", error[known, :2], velocity)
        safe = np.where(speed > SLOWEST, speed, np.nan)
        time_error[known] = -along / safe**2
    return JudgedTracklets(earlier, later, accepted, error, disparity_error, time_error)
