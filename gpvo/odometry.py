"""The odometry, as the paper's figure: stereo events in, a continuous trajectory out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from factors import StereoCamera
from gpvo.calibration import StereoRig
from gpvo.clustering import StereoCluster, cluster_events
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.estimators import make_estimator
from gpvo.mc_ransac import mc_ransac
from gpvo.recordings.base import Recording
from gpvo.threads import one_blas_thread
from gpvo.tracking import MultiResolutionTracker
from gpvo.tracklets import Tracklets
from gpvo.trajectory import Trajectory


@dataclass(frozen=True)
class ClusterReport:
    """What became of one cluster.

    Attributes
    ----------
    start, stop
        Seconds since the recording's start.
    events
        Events of both cameras.
    observations
        Stereo observations that the tracker added.
    tracklets
        Tracklets that reach into the cluster and pass the filters.
    inliers
        Those that MC-RANSAC's velocity explains.
    measurements
        Measurements given to the estimator.
    """

    start: float
    stop: float
    events: int
    observations: int
    tracklets: int
    inliers: int
    measurements: int


class Odometry:
    """Estimates the motion of a stereo event camera.

    >>> odometry = Odometry(recording.rig)
    >>> trajectory = odometry.run(recording)

    `stage`, if given, is entered around every stage with the stage's name, to time it.
    """

    def __init__(
        self,
        rig: StereoRig,
        configuration: Configuration | None = None,
        stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        self.configuration = configuration or Configuration()
        self.reports: list[ClusterReport] = []
        self._rig = rig
        self._stage = stage
        self.camera = StereoCamera(
            rig.focal_length, rig.focal_length, *rig.principal_point, rig.baseline
        )
        self._tracker = MultiResolutionTracker(self.configuration.tracking)
        self._tracklets = Tracklets(self.configuration.tracklets)
        self._rng = np.random.default_rng(self.configuration.seed)
        self.estimator = make_estimator(
            self.camera, self.configuration.noise, self.configuration.estimator
        )

    def run(
        self,
        recording: Recording,
        start: float = 0.0,
        duration: float = np.inf,
        progress: Callable[[ClusterReport], None] | None = None,
    ) -> Trajectory:
        """Process a recording from `start` for `duration` seconds.

        `progress` is called after every cluster.

        Raises
        ------
        InputError
            If the events are faulty, or no landmark could be tracked in any cluster.
        """
        slabs = recording.slabs(start, start + duration)
        clusters = cluster_events(slabs, self._rig, self.configuration.clustering)
        for cluster in self._staged("events and clustering", clusters):
            report = self.process(cluster)
            if progress is not None:
                progress(report)
        trajectory = self.trajectory(recording.start_ns)
        if trajectory is None:
            raise InputError(
                f"{recording.path}: no landmark could be tracked in {len(self.reports)} clusters of"
                " events; is the calibration that of this recording, are left and right swapped?"
            )
        return trajectory

    def process(self, cluster: StereoCluster) -> ClusterReport:
        """Estimate the motion during one more cluster, the next in time."""
        with one_blas_thread():
            return self._process(cluster)

    def _process(self, cluster: StereoCluster) -> ClusterReport:
        with self._stage("tracking"):
            observations = self._tracker.track(cluster)
        with self._stage("tracklets"):
            self._tracklets.add(cluster, observations)
            segments, landmarks = self._tracklets.segments(self.configuration.mc_ransac.span)
        with self._stage("outlier rejection"):
            fit = mc_ransac(
                segments,
                self.camera,
                np.diag(self.configuration.noise.measurement_information),
                self.configuration.mc_ransac,
                self._rng,
            )
            inliers = landmarks[fit.inliers] if fit is not None else landmarks[:0]
            self._tracklets.reject(np.setdiff1d(landmarks, inliers))
        with self._stage("estimation"):
            measurements = self._tracklets.take(inliers)
            self.estimator.update(len(self.reports), cluster.stop, measurements, fit)
        self.reports.append(
            ClusterReport(
                cluster.start,
                cluster.stop,
                cluster.left.event_count + cluster.right.event_count,
                len(observations),
                len(segments),
                len(inliers),
                len(measurements),
            )
        )
        return self.reports[-1]

    def trajectory(self, start_ns: int = 0) -> Trajectory | None:
        """The trajectory so far; None before the first measurement."""
        return self.estimator.trajectory(start_ns)

    def _staged(self, name: str, clusters: Iterator[StereoCluster]) -> Iterator[StereoCluster]:
        """The same clusters, each made within a stage."""
        while True:
            with self._stage(name):
                cluster = next(clusters, None)
            if cluster is None:
                return
            yield cluster
