"""Event clustering: the stream of both cameras is cut into synchronous clusters.

Section III-A.1 of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpvo.config import ClusteringConfig
from gpvo.errors import InputError
from gpvo.events.batch_checks import checked_batch
from gpvo.events.cluster_length import ClusterLength, ImageMotion
from gpvo.events.clusters import ClusterEvents, StereoCluster
from gpvo.events.flashes import FlashDetector
from gpvo.events.noise_filter import EventFilter
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig
from gpvo.recordings.event_queue import EventQueue
from gpvo.second_thread import both

TICK = 1e-6
"""Time that is no gap between batches, seconds: the resolution of stamps."""
WIDEST = 4.0
"""Most times its length that a cluster begins after the one before because time is short: landmarks
are still followed.

On simulated hand-held motion, with half of the features, paths were as good as with 1 up to 4, and
more than twice as far off with 5.
"""
LEAD = 0.03
"""Time before a cluster that the noise filter sees, seconds: it judges events by those before."""
MANY = 50_000
"""Number of events of a batch from which both cameras' are filtered at once."""


class Clustering:
    """Cuts a stereo event stream into clusters, however it comes in batches.

    A cluster ends after `config.window` seconds, or as soon as either camera has too many events;
    see `ClusterLength`. `image_motion` returns that of the features in the clusters so far, as far
    as it is known, and `at_rest` whether nothing moved in the latest one. Flashes are left out, and
    time between clusters: see `ClusterLength.period`.
    """

    def __init__(
        self,
        rig: StereoRig,
        config: ClusteringConfig,
        image_motion: Callable[[], ImageMotion] = ImageMotion,
        at_rest: Callable[[], bool] = lambda: False,
    ) -> None:
        self._image_motion, self._at_rest, self._rig = image_motion, at_rest, rig
        self._skip_flashes = config.skip_flashes
        self._length, self._flashes, self._flash = ClusterLength(config, rig), FlashDetector(), 0.0
        self._hurry = 1.0
        self._sides = [
            _PendingEvents(camera, table, rig.resolution, config)
            for camera, table in zip((rig.left, rig.right), rig.tables, strict=True)
        ]
        self._start = self._stopped = self._end = -np.inf

    def without_noise(self, batch: StereoEvents) -> StereoEvents:
        """Return the next batch as the noise filter leaves it; in any thread, ahead of `add`.

        Both cameras' events are filtered at once if they are many: a thread costs time too. Those
        of time that is left out because time is short are not looked at.

        Raises
        ------
        InputError
            If it is no batch of this rig; see `checked_batch`.
        """
        checked_batch(batch, self._rig)
        begin = self.wanted_from
        left, right = (
            partial(side.without_noise, events, begin)
            for side, events in zip(self._sides, (batch.left, batch.right), strict=True)
        )
        passed = (
            (left(), right()) if len(batch.left) + len(batch.right) < MANY else both(left, right)
        )
        return StereoEvents(batch.start, batch.stop, *passed)

    def add(self, batch: StereoEvents) -> Iterator[StereoCluster]:
        """Yield the clusters that the next batch, without noise, completes.

        Each is to be processed before the next one is taken. A batch that starts later than the
        one before stopped follows time without data, which is in no cluster.

        Raises
        ------
        InputError
            If it starts before the one before stopped.
        """
        if batch.start < self._end - TICK:
            raise InputError(
                f"batch: starts at {batch.start} s, before the one before it stopped, at"
                f" {self._end} s; push batches in order of time, or begin a new odometry"
            )
        if batch.start > self._end + TICK:
            yield from self.end()
            self._start, self._stopped = max(self._start, batch.start), batch.start
        self._end = batch.stop
        for side, events in zip(self._sides, (batch.left, batch.right), strict=True):
            side.add(events)
        while (stop := self._next_stop()) <= self._end:
            duration = stop - self._start
            yield from self._without_flashes(self._take(stop))
            self._pause(duration)

    def is_due(self, stop: float, waiting: int) -> bool:
        """Whether a batch until `stop`, with at most so many events of a camera, is to be added.

        It is if it may end a cluster, or covers half of one: less is left to do at the end then.
        The noise filter has not seen the events, so that there may be fewer.
        """
        duration, limit = self._limits()
        most = waiting + max(side.count(self._start) for side in self._sides)
        may_end = stop >= self._start + duration or most >= limit
        return may_end or stop >= max(self._start, self._end) + 0.5 * duration

    def hurry(self, times: float) -> None:
        """Let clusters begin so many times farther apart than usual, at least once.

        That is at most `WIDEST` times their length, or what is usual.
        """
        self._hurry = times
        if times > 1:
            for side in self._sides:
                side.filter.interrupt()

    @property
    def wanted_from(self) -> float:
        """Time before which no events are needed any more, seconds; -inf if all are."""
        return self._start - LEAD if self._hurry > 1 else -np.inf

    def clusters(self, batches: Iterable[StereoEvents]) -> Iterator[StereoCluster]:
        """Yield the clusters of a whole stream."""
        for batch in batches:
            yield from self.add(self.without_noise(batch))
        yield from self.end()

    def end(self) -> Iterator[StereoCluster]:
        """Yield the last cluster, unless the stream fills less than half of it.

        It begins earlier, in the time after the cluster before, if it would be short else.
        """
        duration, limit = self._limits()
        earliest = max(self._stopped, self.wanted_from)
        self._start = max(earliest, min(self._start, self._end - duration))
        if self._end <= self._start:
            return
        counts = [side.count(self._start) for side in self._sides]
        full = (self._end - self._start) / duration, *(count / limit for count in counts)
        cluster = self._take(self._end)
        if max(full) >= 0.5:
            yield cluster
            self._flash = 0.0

    def _pause(self, duration: float) -> None:
        """Leave out time after a cluster of `duration` seconds.

        Where the image motion is unknown the next one follows at once: features are found in one
        cluster and known to be right when they are followed into another.
        """
        motion = self._image_motion()
        if motion.speed is None:
            return
        usual = self._length.period(duration, motion)
        period = max(usual, min(self._hurry * usual, WIDEST * duration))
        self._start += max(period - duration, 0.0)

    def _limits(self) -> tuple[float, int]:
        return self._length.limits(self._image_motion(), self._at_rest())

    def _next_stop(self) -> float:
        duration, limit = self._limits()
        full = (side.full_at(self._start, limit) for side in self._sides)
        return min(self._start + duration, *full)

    def _take(self, stop: float) -> StereoCluster:
        start, self._start, self._stopped = self._start, stop, stop
        left, right = (side.take(start, stop) for side in self._sides)
        between = sum(side.take_left_out() for side in self._sides)
        return StereoCluster(start, stop, left, right, self._flash, between)

    def _without_flashes(self, cluster: StereoCluster) -> Iterator[StereoCluster]:
        left, right, duration = cluster.left, cluster.right, cluster.stop - cluster.start
        if self._skip_flashes and self._flashes.is_flash(
            duration, max(left.coverage, right.coverage)
        ):
            self._flash += duration
            return
        events = max(left.event_count, right.event_count)
        self._length.add(events, max(left.contour_count, right.contour_count), duration)
        yield cluster
        self._flash = 0.0


class _PendingEvents:
    """Filtered events of one camera since the latest cluster."""

    def __init__(
        self,
        camera: Camera,
        table: NDArray[np.float32],
        resolution: tuple[int, int],
        config: ClusteringConfig,
    ) -> None:
        self._table, self._resolution = table, resolution
        self.filter = EventFilter(camera.resolution, config)
        self._pixels = camera.resolution[0] * camera.resolution[1]
        self._waiting, self._left_out = EventQueue(), 0

    def count(self, start: float) -> int:
        """Return the number of events since `start`, seconds."""
        return len(self._waiting) - self._waiting.count_before(start)

    def without_noise(self, events: Events, begin: float) -> Events:
        """Filter the next events of the stream; leave out those before `begin`, seconds."""
        wanted = events.between(begin, np.inf)
        self._left_out += len(events) - len(wanted)
        return self.filter(wanted)

    def add(self, events: Events) -> None:
        """Add the next events of the stream, filtered."""
        self._waiting.add(events)

    def take_left_out(self) -> int:
        """Return the number of events that were left out since it was asked last."""
        count, self._left_out = self._left_out, 0
        return count

    def full_at(self, start: float, limit: int) -> float:
        """Return the time just after so many events since `start`, seconds; inf if fewer."""
        last = self._waiting.count_before(start) + limit - 1
        return float(np.nextafter(self._waiting.time_of(last), np.inf))

    def take(self, start: float, stop: float) -> ClusterEvents:
        """Return the events in [start, stop), seconds, as a cluster's, and keep those after it."""
        self._left_out += sum(map(len, self._waiting.take(start)))
        noise = self.filter.noise(start, stop)
        return ClusterEvents(
            self._waiting.take(stop),
            self._table,
            self._resolution,
            noise_rate=noise.rate,
            noise_count=noise.passing * self._pixels * (stop - start),
            left_out=self.filter.left_out(stop),
        )
