"""A live odometry fed from a source: a thread takes events in, and load is shed when they wait."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from threading import Condition, Thread

import numpy as np

from gpvo.cluster_report import ClusterReport
from gpvo.live.latency import Latency
from gpvo.live.live_odometry import LiveOdometry
from gpvo.live.load import LONGEST, Load
from gpvo.live.raw_events import RawEvents
from gpvo.live.repair import Repair
from gpvo.live.sources.packet import Packet, Source
from gpvo.recordings import StereoRig
from gpvo.recordings.streams import EventBlock

log = logging.getLogger("gpvo.live")

MOST_WAITING = 20_000_000
"""Number of events that may wait, 260 MB."""


class Intake:
    """Packets that wait, taken from a source by a thread.

    Attributes
    ----------
    discarded
        Number of events that were thrown away because too many waited.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._waiting: deque[Packet] = deque()
        self._changed = Condition()
        self._at_end = False
        self.discarded = 0
        self._failure: BaseException | None = None
        self._thread = Thread(target=self._fill, name="gpvo live intake", daemon=True)
        self._thread.start()

    def take(self) -> Packet | None:
        """Return the next packet, waiting for it; None at the source's end.

        Raises what the source raised.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._at_end)
            if self._waiting:
                return self._waiting.popleft()
        if self._failure is not None:
            raise self._failure
        return None

    def take_all(self) -> list[Packet]:
        """Return all packets that wait."""
        with self._changed:
            packets = list(self._waiting)
            self._waiting.clear()
        return packets

    def close(self) -> None:
        """End the source and its thread."""
        self._source.close()
        self._thread.join(timeout=1.0)

    def _fill(self) -> None:
        try:
            is_gap = False
            for packet in self._source.packets():
                with self._changed:
                    self._waiting.append(replace(packet, after_gap=packet.after_gap or is_gap))
                    self._changed.notify()
                    is_gap = sum(map(len, self._waiting)) > MOST_WAITING
                if is_gap:
                    self.discarded += sum(map(len, self.take_all()))
        except BaseException as error:
            self._failure = error
        with self._changed:
            self._at_end = True
            self._changed.notify()


class LiveSession:
    """Runs a live odometry from a source until it ends.

    Parameters
    ----------
    live
        The odometry.
    rig
        Of the cameras.
    source
        Where the events come from.
    record
        Called with the repaired events of each packet, to keep them.

    Attributes
    ----------
    latency, load, faults
        How late the estimates are, what was shed, and what was repaired.
    """

    def __init__(
        self,
        live: LiveOdometry,
        rig: StereoRig,
        source: Source,
        record: Callable[[EventBlock, EventBlock], None] | None = None,
    ) -> None:
        self.live, self.latency, self.load = live, Latency(), Load()
        self._repair, self._record = Repair(rig), record
        self._source, self._missing = source, False
        self._to_estimate: list[float] = []

    @property
    def faults(self) -> dict[str, int]:
        """Kinds of faults that were repaired, and their numbers."""
        return dict(self._repair.faults)

    def run(self, progress: Callable[[ClusterReport], None] = lambda _: None) -> None:
        """Estimate until the source ends; `progress` is called after each cluster."""
        intake = Intake(self._source)
        try:
            while (packet := intake.take()) is not None:
                if self._has_time(packet):
                    self._process(*self._received(packet), packet.arrival, progress)
                else:
                    self._discard([packet, *intake.take_all()])
            self.load.discarded += intake.discarded
        finally:
            intake.close()

    def end(self) -> None:
        """End the source, so that `run` ends."""
        self._source.close()

    def _has_time(self, packet: Packet) -> bool:
        """Shed more or less, by how long a packet has waited; False if it was too long."""
        now = time.perf_counter()
        age, was_full = now - packet.arrival, self.load.is_full
        self.load.update(age, now)
        if was_full and not self.load.is_full:
            log.warning("the computer cannot keep up: features and events are left out")
        elif self.load.is_full and not was_full:
            log.warning("keeping up again: nothing is left out")
        self.live.odometry.limit_features(self.load.level.features)
        return age <= LONGEST

    def _received(self, packet: Packet) -> tuple[EventBlock, EventBlock]:
        """Repair a packet's events and keep them."""
        left, right, is_gap = self._repair(packet)
        self._missing |= is_gap
        if self._record is not None:
            self._record(left, right)
        return left, right

    def _discard(self, packets: list[Packet]) -> None:
        """Keep the events, but estimate nothing of them."""
        for packet in packets:
            self.load.discarded += sum(map(len, self._received(packet)))
        self._missing = True

    def _process(
        self,
        left: EventBlock,
        right: EventBlock,
        arrival: float,
        progress: Callable[[ClusterReport], None],
    ) -> None:
        if self._missing:
            self._show(self.live.interrupted(), progress)
            self._missing = False
        if len(left) + len(right) == 0:
            return
        first = min(int(block.t_ns[0]) for block in (left, right) if len(block))
        self.latency.arrived(first, arrival)
        sides = raw(self.load.thin(left)), raw(self.load.thin(right))
        self._show(self.live.push(*sides), progress)

    def _show(
        self, reports: list[ClusterReport], progress: Callable[[ClusterReport], None]
    ) -> None:
        now, start_ns = time.perf_counter(), self.live.start_ns or 0
        self._to_estimate += [report.stop for report in reports]
        latest = self.live.latest()
        # Short clusters are estimated together.
        while self._to_estimate and latest is not None and self._to_estimate[0] <= latest.t:
            stop = self._to_estimate.pop(0)
            self.latency.estimated(start_ns + round(stop * 1e9), now)
        for report in reports:
            progress(report)


def raw(block: EventBlock) -> RawEvents:
    """Return events as `LiveOdometry` takes them."""
    return block.x, block.y, block.t_ns // 1000, block.polarity.astype(np.bool_)
