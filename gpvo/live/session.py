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
from gpvo.live.repair import Repair
from gpvo.live.sources.packet import Packet, Source
from gpvo.observer import Step
from gpvo.process_setting import quick_switches, short_collections
from gpvo.recordings import StereoRig
from gpvo.recordings.streams import EventBlock

log = logging.getLogger("gpvo.live")

MOST_WAITING = 20_000_000
"""Number of events that may wait, 260 MB."""
TOGETHER = 8
"""Number of packets that are pushed together if they wait, because each push costs time."""


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

    def take(self) -> list[Packet]:
        """Return the oldest packets that wait, waiting for one; none at the source's end.

        Raises what the source raised.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._at_end)
            packets = [self._waiting.popleft() for _ in range(min(len(self._waiting), TOGETHER))]
        if not packets and self._failure is not None:
            raise self._failure
        return packets

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
        self.live, self.latency = live, Latency()
        self.load = Load()
        self._repair, self._record = Repair(rig, live.right_offset), record
        self._source, self._missing, self._skipped = source, False, False
        self._work, self._worked_until, self._arrival = 0.0, 0.0, 0.0
        self._to_estimate: list[float] = []
        self._progress: Callable[[ClusterReport], None] = lambda _: None
        live.observe(self._estimated)
        live.watch(lambda step: self._progress(step.report))

    @property
    def faults(self) -> dict[str, int]:
        """Kinds of faults that were repaired, and their numbers."""
        return dict(self._repair.faults)

    def run(self, progress: Callable[[ClusterReport], None] = lambda _: None) -> None:
        """Estimate until the source ends.

        `progress` is called after each cluster, in the thread that estimates.
        """
        self._progress = progress
        with quick_switches(), short_collections():
            intake = Intake(self._source)
            try:
                while packets := intake.take():
                    if self._has_time(packets[0]):
                        self._process(packets)
                    else:
                        self._discard([*packets, *intake.take_all()])
                self.load.discarded += intake.discarded
            finally:
                intake.close()

    def end(self) -> None:
        """End the source, so that `run` ends."""
        self._source.close()

    def _has_time(self, packet: Packet) -> bool:
        """Shed more or less, by how long a packet has waited; False if it was too long."""
        now = time.perf_counter()
        age, was_behind = now - packet.arrival, self.load.is_behind
        self.load.waited(age, now)
        level = self.load.level
        if self.load.is_behind and not was_behind:
            log.warning("the computer cannot keep up; used are %s", level)
        elif was_behind and not self.load.is_behind:
            log.warning("keeping up again")
        self.live.odometry.relieve(level.features, level.spacing)
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
        self._missing = self._skipped = True

    def _process(self, packets: list[Packet]) -> None:
        """Push packets together, but those after a gap apart."""
        began = time.perf_counter()
        together: list[tuple[EventBlock, EventBlock]] = []
        for packet in packets:
            sides = self._received(packet)
            if self._is_unwanted(sides):
                self.load.left_out += sum(map(len, sides))
                self._missing = self._skipped = True
                continue
            if self._missing:
                self._push(together)
                self.live.interrupted(on_purpose=self._skipped)
                together, self._missing, self._skipped = [], False, False
            stamps = [int(block.t_ns[0]) for block in sides if len(block)]
            if stamps:
                self.latency.arrived(min(stamps), packet.arrival)
                together.append(sides)
        self._push(together)
        self._note_work(time.perf_counter() - began, packets[-1].arrival)

    def _is_unwanted(self, sides: tuple[EventBlock, EventBlock]) -> bool:
        """Whether all events are of time that is left out between clusters."""
        start_ns, wanted_from = self.live.start_ns, self.live.odometry.wanted_from
        if start_ns is None or not np.isfinite(wanted_from) or self.live.right_offset:
            return False
        newest = [int(block.t_ns[-1]) for block in sides if len(block)]
        return bool(newest) and max(newest) < start_ns + round(wanted_from * 1e9)

    def _note_work(self, seconds: float, arrival: float) -> None:
        """Tell the load how long the work on a cluster took, and its events to arrive."""
        self._work += seconds
        until = self.live.odometry.tracked_until
        if until > self._worked_until:
            self.load.worked(self._work, arrival - self._arrival, self.latency.newest)
            self._work, self._worked_until, self._arrival = 0.0, until, arrival

    def _push(self, packets: list[tuple[EventBlock, EventBlock]]) -> None:
        if packets:
            left, right = (EventBlock.concatenate(side) for side in zip(*packets, strict=True))
            self.live.push_checked(left, right)

    def _estimated(self, step: Step) -> None:
        """Note how late the clusters are of which the latest estimate knows."""
        self.load.left_out += step.report.between
        now, start_ns, latest = time.perf_counter(), self.live.start_ns or 0, self.live.latest()
        self._to_estimate.append(step.report.stop)
        # Short clusters are estimated together.
        while self._to_estimate and latest is not None and self._to_estimate[0] <= latest.t:
            stop = self._to_estimate.pop(0)
            self.latency.estimated(start_ns + round(stop * 1e9), now)
