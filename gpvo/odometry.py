"""The odometry, as the paper's figure: stereo events in, a continuous trajectory out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.estimator import Estimator, make_estimator, one_blas_thread
from gpvo.events import StereoCluster
from gpvo.front_end import FrontEnd
from gpvo.recordings import Recording, StereoEvents, StereoRig
from gpvo.tracking import Tracker
from gpvo.trajectory import Trajectory

T = TypeVar("T")


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

    `stage`, if given, is entered around every stage with the stage's name, to time it. `tracker`
    and `estimator` take the place of those that the configuration names.
    """

    def __init__(
        self,
        rig: StereoRig,
        configuration: Configuration | None = None,
        stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
        tracker: Tracker | None = None,
        estimator: Estimator | None = None,
    ) -> None:
        self.reports: list[ClusterReport] = []
        self._stage = stage
        self._front_end = FrontEnd(rig, configuration or Configuration(), tracker, stage)
        self.configuration = self._front_end.configuration
        self.camera = self._front_end.camera
        self.estimator = estimator or make_estimator(
            self.camera, self._front_end.noise, self.configuration.estimator
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
        batches = prefetched(recording.event_batches(start, start + duration))
        for cluster in self.clusters(batches):
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

    def clusters(self, batches: Iterable[StereoEvents]) -> Iterator[StereoCluster]:
        """Cut a stream into clusters, each to be processed before the next one is taken."""
        return self._staged("events and clustering", self._front_end.clusters(batches))

    def process(self, cluster: StereoCluster) -> ClusterReport:
        """Estimate the motion during one more cluster, the next in time."""
        with one_blas_thread():
            return self._process(cluster)

    def _process(self, cluster: StereoCluster) -> ClusterReport:
        tracked = self._front_end.process(cluster)
        with self._stage("estimation"):
            self.estimator.update(cluster.stop, tracked.measurements, tracked.velocity_estimate)
        self.reports.append(
            ClusterReport(
                cluster.start,
                cluster.stop,
                cluster.left.event_count + cluster.right.event_count,
                len(tracked.observations),
                len(tracked.later),
                int(tracked.inliers.sum()),
                len(tracked.measurements),
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


def prefetched(items: Iterator[T], ahead: int = 3) -> Iterator[T]:
    """The same items, made in a thread of its own up to some ahead of the one that is in use."""
    with ThreadPoolExecutor(1) as thread:
        coming = deque(thread.submit(next, items, None) for _ in range(ahead))
        while (item := coming.popleft().result()) is not None:
            coming.append(thread.submit(next, items, None))
            yield item
