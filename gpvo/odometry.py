"""The odometry, as the paper's figure: stereo events in, a continuous trajectory out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from itertools import takewhile
from typing import Any

import numpy as np

from gpvo.cluster_report import ClusterReport
from gpvo.config import Configuration
from gpvo.errors import InputError, require_type
from gpvo.estimator import Estimator, GatheredMeasurements, make_estimator, one_blas_thread
from gpvo.events import StereoCluster
from gpvo.faults import Fault, FaultWatch
from gpvo.front_end import FrontEnd, TrackedCluster
from gpvo.lost_stage import lost_stage
from gpvo.observer import Observer, Step, no_observer
from gpvo.process_setting import quick_switches
from gpvo.recordings import Recording, StereoEvents, StereoRig
from gpvo.second_thread import SecondThread, prefetched
from gpvo.tracking import Tracker
from gpvo.trajectory import MotionEstimate, Trajectory
from gpvo.verdict import Verdict, verdict


class Odometry:
    """Estimates the motion of a stereo event camera.

    >>> odometry = Odometry(recording.rig)
    >>> trajectory = odometry.run(recording)

    `stage`, if given, is entered around every stage with the stage's name, to time it. `tracker`
    and `estimator` take the place of those that the configuration names. `observer` is called with
    a `Step` after each cluster, in the thread that estimates; so is `watcher`, when all is ready
    for the next estimate: a viewer may take its time. Faults of the events are said while they
    come, each kind once, also where landmarks are lost if most clusters of the first second have no
    inliers.

    Attributes
    ----------
    reports
        Of the clusters that were estimated.
    tracked_until
        End of the newest cluster that was tracked, seconds.

    Raises
    ------
    InputError
        If the rig or the configuration is something else, such as a path.
    """

    def __init__(
        self,
        rig: StereoRig,
        configuration: Configuration | None = None,
        stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
        tracker: Tracker | None = None,
        estimator: Estimator | None = None,
        observer: Observer = no_observer,
        watcher: Observer = no_observer,
    ) -> None:
        configuration = Configuration() if configuration is None else configuration
        require_type("rig", rig, StereoRig, "read_calibration(path) or recording.rig")
        require_type("configuration", configuration, Configuration, "load_configuration(path)")
        self.reports: list[ClusterReport] = []
        self.tracked_until = 0.0
        self._stage, self._observer, self._watcher = stage, observer, watcher
        self._watch, self._unwatched = FaultWatch(rig), list[StereoEvents | None]()
        self._front_end = FrontEnd(rig, configuration, tracker, stage)
        self.configuration = self._front_end.configuration
        self.camera = self._front_end.camera
        config = self.configuration.estimator
        self.estimator = estimator or make_estimator(self.camera, self._front_end.noise, config)
        self._measurements = GatheredMeasurements(self.estimator, config)
        self._estimates = SecondThread[ClusterReport]()
        self._latest: MotionEstimate | None = None

    def run(
        self,
        recording: Recording,
        start: float = 0.0,
        duration: float = np.inf,
        ended: Callable[[], bool] = lambda: False,
    ) -> Trajectory:
        """Process a recording from `start` for `duration` seconds.

        Once `ended` returns True, no more is read or estimated.

        Raises
        ------
        InputError
            If the events are faulty, or no landmark could be tracked in any cluster.
        """
        for _ in self.reports_of(recording.event_batches(start, start + duration), ended):
            pass
        trajectory = self.trajectory(recording.start_ns)
        if trajectory is None:
            raise InputError(f"{recording.path}: no landmark could be tracked: {self._why_lost()}")
        return trajectory

    def reports_of(
        self, batches: Iterable[StereoEvents], ended: Callable[[], bool] = lambda: False
    ) -> Iterator[ClusterReport]:
        """Estimate the motion during a whole stream, until `ended`, and report every cluster.

        Nothing is estimated while a report is out, so that the estimator may be asked then. The
        batches are taken ahead, in a thread of their own.
        """
        clusters = self._clusters(takewhile(lambda _: not ended(), batches))
        # It is asked at each cluster as well: a batch without events may be hours long.
        yield from self._reports(takewhile(lambda _: not ended(), clusters))
        yield from self._ended()

    def push(self, batch: StereoEvents) -> Iterator[ClusterReport]:
        """Track the clusters that the next batch completes; report those that were estimated.

        The latest may still be estimated when this returns, and is reported by a later call. A
        batch that starts later than the one before stopped follows time without data.
        """
        without_noise = self._front_end.clustering.without_noise(batch)
        yield from self._reports(self._completed(batch, without_noise))
        yield from self.estimated()

    def estimated(self) -> Iterator[ClusterReport]:
        """Report the clusters that were estimated and not reported yet, without waiting."""
        yield from self._estimates.done()

    def is_due(self, stop: float, waiting: int) -> bool:
        """Whether a batch until `stop`, with at most so many events of a camera, is to be pushed.

        Others may wait for the next one: each batch costs time.
        """
        return self._front_end.clustering.is_due(stop, waiting)

    def end(self) -> Iterator[ClusterReport]:
        """Estimate the motion during what is left after the last batch."""
        yield from self._reports(self._front_end.clustering.end())
        yield from self._ended()

    @property
    def wanted_from(self) -> float:
        """Time before which no events are needed any more, seconds; -inf if all are."""
        return self._front_end.clustering.wanted_from

    def skip(self) -> None:
        """Say that events are left out on purpose before the next batch."""
        self._unwatched.append(None)

    def settle(self) -> None:
        """Wait until all clusters that were tracked are estimated; then nothing changes."""
        self._estimates.settle()

    def _reports(self, clusters: Iterator[StereoCluster]) -> Iterator[ClusterReport]:
        """Process clusters; the next one is tracked while the motion during one is estimated."""
        with one_blas_thread(), quick_switches():
            for cluster in self._staged(clusters):
                tracked = self._front_end.process(cluster)
                self.tracked_until = cluster.stop
                report = ClusterReport.of(cluster, tracked)
                yield from self._estimates.wait()
                self._front_end.tell_estimate(self._latest)
                batches = self._take_unwatched()
                self._estimates.start(self._estimate, cluster, tracked, report, batches)

    def _clusters(self, batches: Iterable[StereoEvents]) -> Iterator[StereoCluster]:
        """Cut a whole stream into clusters; events are read, and filtered, beside this."""
        clustering, read = self._front_end.clustering, prefetched(iter(batches), ahead=4)
        filtered = ((batch, clustering.without_noise(batch)) for batch in read)
        for batch, without_noise in prefetched(filtered):
            yield from self._completed(batch, without_noise)
        yield from clustering.end()

    def _completed(
        self, batch: StereoEvents, without_noise: StereoEvents
    ) -> Iterator[StereoCluster]:
        """Yield the clusters that the next batch completes; then it is to be looked at."""
        yield from self._front_end.clustering.add(without_noise)
        self._unwatched.append(batch)

    def _take_unwatched(self) -> list[StereoEvents | None]:
        """Return the batches that were not looked at for faults yet."""
        batches, self._unwatched = self._unwatched, []
        return batches

    def _ended(self) -> Iterator[ClusterReport]:
        yield from self._estimates.wait()
        for batch in self._take_unwatched():
            self._watch.see_events(batch)
        with one_blas_thread():
            self._measurements.end()

    def _estimate(
        self,
        cluster: StereoCluster,
        tracked: TrackedCluster,
        report: ClusterReport,
        batches: list[StereoEvents | None],
    ) -> ClusterReport:
        """Estimate the motion during a cluster; what can be done after that is.

        It, and the batches that came since the cluster before, are looked at for faults.
        """
        # With several threads of BLAS results would differ in their last bits.
        with self._stage("estimation"), one_blas_thread():
            self._measurements.add(cluster.stop, tracked.measurements, tracked.velocity_estimate)
            self._latest = self.estimator.latest()
        self.reports.append(report)
        step = Step(cluster, tracked, report, self.estimator)
        self._observer(step)
        with self._stage("estimation"):
            self._measurements.prepare()
        self._watcher(step)
        for batch in batches:
            self._watch.see_events(batch)
        self._watch.see_cluster(cluster, report)
        return report

    def _why_lost(self) -> str:
        """Say where landmarks are lost, and what was found before."""
        kinds = [fault.kind for fault in self.faults if fault.harms and fault.kind != "lost"]
        before = f"; found before: {', '.join(kinds)}" if kinds else ""
        return lost_stage(self.reports) + before

    @property
    def faults(self) -> list[Fault]:
        """Faults that were found so far."""
        return self._watch.faults

    @property
    def stream_numbers(self) -> dict[str, Any]:
        """What was measured of the events so far: rates, silences, offset of the clocks."""
        return self._watch.numbers

    def verdict(self) -> Verdict:
        """Judge the run so far.

        Raises
        ------
        InputError
            If there was no cluster of events yet.
        """
        if not self.reports:
            raise InputError("no verdict: there was no cluster of events yet")
        return verdict(self.reports, self.faults, self.trajectory())

    @property
    def measurement_information(self) -> tuple[float, ...]:
        """Diagonal of R^-1 as it is used now, 1 / pixel^2."""
        noise = getattr(self.estimator, "noise", self._front_end.noise)
        return tuple(noise.measurement_information)

    def relieve(self, features: float, spacing: float) -> None:
        """Do less while time is short; see `FrontEnd`."""
        self._front_end.relieve(features, spacing)

    def trajectory(self, start_ns: int = 0) -> Trajectory | None:
        """The trajectory so far; None before the first measurement."""
        return self.estimator.trajectory(start_ns)

    def _staged(self, clusters: Iterator[StereoCluster]) -> Iterator[StereoCluster]:
        """The same clusters, each made within their stage."""
        while True:
            with self._stage("events and clustering"):
                cluster = next(clusters, None)
            if cluster is None:
                return
            yield cluster
