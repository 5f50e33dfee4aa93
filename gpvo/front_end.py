"""The front end of the paper: from a cluster of events to measurements of inlier tracklets."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpvo.config import Configuration, for_camera, in_full_pixels
from gpvo.events import Clustering, ImageMotion, StereoCluster
from gpvo.mc_ransac import (
    TrackRecord,
    VelocityFit,
    mc_ransac,
    segments_between,
    trusted_velocity,
)
from gpvo.recordings import StereoRig
from gpvo.tracking import (
    EgoMotion,
    ImageAcceleration,
    Measurements,
    MultiResolutionTracker,
    Observations,
    Tracker,
    TrackingReport,
    Tracklets,
)
from gpvo.trajectory import MotionEstimate

FEW_INLIERS = 6
"""Number of inliers below which a cluster hardly measures the motion: twice the smallest sample."""
AGREE = 0.5
"""Share of the features that are inliers where the motion is known well."""


@dataclass(frozen=True, eq=False)
class TrackedCluster:
    """Results of the front end for one cluster.

    Attributes
    ----------
    observations
        Stereo observations that the tracker added: those followed into the cluster, and those that
        were found in the cluster before.
    tracking
        What the tracker says of the cluster; None if it says nothing.
    out_of_bounds, too_short
        Numbers of observations and of tracklets that the filters left out.
    earlier, later
        The ends of the N tracklets that reach into the cluster and pass the filters.
    velocity_estimate
        MC-RANSAC's velocity; None if it finds none.
    inliers
        (N,) bool, tracklets that agree with the velocity; none without a velocity.
    measurements
        Measurements of the inliers, except those returned with earlier clusters.
    """

    observations: Observations
    tracking: TrackingReport | None
    out_of_bounds: int
    too_short: int
    earlier: Measurements
    later: Measurements
    velocity_estimate: VelocityFit | None
    inliers: NDArray[np.bool_]
    measurements: Measurements


class FrontEnd:
    """The stages before the estimator: tracking, tracklets, outlier rejection.

    `tracker` replaces the configured one. `stage` makes a context manager from a stage's name, to
    be entered around that stage, for instance to time it.

    Attributes
    ----------
    camera
        The rectified stereo camera.
    configuration
        The configuration with what follows from the camera.
    noise
        Covariances of motion and measurements, in pixels of the sensor.
    rng
        Random numbers for MC-RANSAC's samples.
    clustering
        Cuts the events into clusters, each to be processed before the next one is taken.
    """

    def __init__(
        self,
        rig: StereoRig,
        configuration: Configuration,
        tracker: Tracker | None = None,
        stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        self.camera = rig.stereo_camera
        self.configuration = for_camera(configuration, rig.left.resolution, rig.focal_length)
        full = in_full_pixels(self.configuration)
        self.noise = full.noise
        self.rng = np.random.default_rng(full.seed)
        self._config = full.mc_ransac
        self._information = np.diag(full.noise.measurement_information)
        self._tracker = (
            MultiResolutionTracker(full.tracking, self.camera) if tracker is None else tracker
        )
        self._tracklets = Tracklets(full.tracklets, full.tracking.earlier_frames)
        self._record = TrackRecord() if full.mc_ransac.track_record else None
        self._tracked_pixel = full.tracking.pixel
        self._acceleration = ImageAcceleration(self.camera)
        self._image_speed: float | None = None
        self._inliers, self._share = 0, 1.0
        self._latest: MotionEstimate | None = None
        self._stage = stage
        self.clustering = Clustering(
            rig, self.configuration.clustering, self._tracked_motion, self._at_rest
        )
        self._span = self._span_of(1.0)

    def relieve(self, features: float, spacing: float) -> None:
        """Do less while time is short.

        Track a share of the configured features, from 0 to 1, in clusters that are `spacing` times
        farther apart than usual. A tracker of a user's own is left alone.
        """
        if isinstance(self._tracker, MultiResolutionTracker):
            self._tracker.limit_features(features, spacing)
        self._share = features
        self.clustering.hurry(spacing)
        self._span = self._span_of(spacing)

    def _span_of(self, spacing: float) -> int:
        """Return the span of segments: their velocity is constant for a time, not for clusters."""
        apart = self.configuration.clustering.spacing * spacing
        return max(1, round(self._config.span / apart))

    def process(self, cluster: StereoCluster) -> TrackedCluster:
        """Track landmarks into the next cluster, in order of time, and reject outliers."""
        with self._stage("tracking"):
            observations = self._tracker.track(cluster)
        with self._stage("tracklets"):
            self._tracklets.add(cluster, observations)
            earlier, later = self._tracklets.pairs(self._span)
            too_short = self._tracklets.too_short()
        with self._stage("outlier rejection"):
            estimate = self._velocity(earlier, later)
            inliers = np.zeros(len(later), bool) if estimate is None else estimate.inliers
            self._tracklets.reject(later.landmark[~inliers])
            measurements = self._tracklets.take(later.landmark[inliers])
        self._inliers = int(inliers.sum())
        self._learn_motion(cluster, later, estimate)
        return TrackedCluster(
            observations,
            self._tracking_report(),
            self._tracklets.out_of_bounds,
            too_short,
            earlier,
            later,
            estimate,
            inliers,
            measurements,
        )

    def _velocity(self, earlier: Measurements, later: Measurements) -> VelocityFit | None:
        """Find the velocity during the segments between measurements (N,) of the same landmarks."""
        segments, known = segments_between(earlier, later), self._record
        trusted = None if known is None else known.trusted(later.landmark)
        given = self.camera, self._information, self._config, self.rng
        estimate = mc_ransac(segments, *given, trusted)
        if known is not None and estimate is not None:
            known.judge(later.landmark, estimate.inliers)
        return estimate

    def _learn_motion(
        self, cluster: StereoCluster, later: Measurements, estimate: VelocityFit | None
    ) -> None:
        """Learn what the next cluster's length and tracks depend on: how fast images move."""
        if estimate is not None and self._inliers >= FEW_INLIERS:
            self._acceleration.follow(cluster.stop, estimate.velocity, later.stereo[:, 2])
        else:
            self._acceleration.wait(cluster.stop)
        if self._motion is not None:
            self._motion.velocity = trusted_velocity(estimate, self._latest, cluster.middle)
        self._image_speed = self._tracklets.image_speed()

    def _tracked_motion(self) -> ImageMotion:
        """Return the motion of the features in tracked pixels.

        Its speed is unknown while few are known, and where it turns; what it will be is unknown
        where few landmarks agree on what it is.
        """
        report, pixel, known = self._tracking_report(), self._tracked_pixel, self._acceleration
        if self._image_speed is None or (report is not None and report.turns):
            return ImageMotion(acceleration=known.value / pixel)
        agree = self._inliers >= AGREE * self._share * self.configuration.tracking.klt.features(0.0)
        latest = self._latest
        density = known.density(latest.qc) if agree and latest is not None else np.inf
        return ImageMotion(self._image_speed / pixel, known.value / pixel, density / pixel**2)

    def _at_rest(self) -> bool:
        """Return whether nothing moved in the latest cluster."""
        report = self._tracking_report()
        return report is not None and report.at_rest

    def tell_estimate(self, latest: MotionEstimate | None) -> None:
        """Tell the estimate at the cluster before: the pose to the tracker, Q_c to the clustering.

        A tracker of a user's own may not need it.
        """
        if latest is None:
            return
        self._latest = latest
        if self._motion is not None:
            self._motion.restart(latest.t, latest.T_world_cam)

    @property
    def _motion(self) -> EgoMotion | None:
        """What the tracker is told of the camera's motion; None if it does not ask for it."""
        motion = getattr(self._tracker, "motion", None)
        return motion if isinstance(motion, EgoMotion) else None

    def _tracking_report(self) -> TrackingReport | None:
        """Return what the tracker says of the latest cluster, which a user's own need not do."""
        report = getattr(self._tracker, "report", None)
        return report if isinstance(report, TrackingReport) else None
