"""Make of cameras' events what `LiveOdometry` takes: on the sensor, in order, on one clock."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from gpvo.live.sources.packet import Packet
from gpvo.recordings import Camera, StereoRig
from gpvo.recordings.checks.clocks import LARGEST_DELAY_NS
from gpvo.recordings.checks.first_faulty import first_faulty
from gpvo.recordings.checks.time_order import DISORDER_NS, FEWEST_AFTER_GAP
from gpvo.recordings.streams import EventBlock, Faults

log = logging.getLogger("gpvo.live")

JUMP_NS = 10_000_000_000
"""Stamps that are later by more have jumped."""
DRIFT_NS = 5_000_000
"""Change of the clocks' offset that is said."""
SETTLED = 2.0
"""Seconds over which the least delay of each camera's events is taken."""


class Clock:
    """The shift of stamps that both cameras last needed after their clock jumped, nanoseconds."""

    def __init__(self) -> None:
        self.shift_ns = 0


class CameraRepair:
    """Repairs one camera's events.

    Attributes
    ----------
    faults
        Kinds of faults and numbers of events.
    """

    def __init__(self, name: str, camera: Camera, clock: Clock) -> None:
        self.faults = Faults()
        self._name, self._camera, self._clock = name, camera, clock
        self._newest_ns: int | None = None
        self._shift_ns, self._arrival = 0, 0.0

    def __call__(self, block: EventBlock, arrival: float) -> tuple[EventBlock, bool]:
        """Return what can be used of a block, and whether its stamps jumped."""
        jumped = False
        if len(block) and self._is_faultless(block):
            block = self._shifted(block)
        elif len(block := self._inside(block)):
            block = self._without_islands(block)
            jumped = self._follow_jump(int(block.t_ns[0]), arrival)
            block = self._in_order(self._shifted(block))
        if len(block):
            self._newest_ns, self._arrival = int(block.t_ns[-1]), arrival
        return block, jumped

    def _is_faultless(self, block: EventBlock) -> bool:
        """Whether there is nothing to repair, as in almost all blocks: found in one pass."""
        first_ns, newest_ns = int(block.t_ns[0]), self._newest_ns
        before_ns = first_ns if newest_ns is None else newest_ns - self._shift_ns
        if int(block.t_ns[-1]) - before_ns > JUMP_NS:
            return False
        return first_faulty(block.x, block.y, block.t_ns, self._camera, before_ns) is None

    def _shifted(self, block: EventBlock) -> EventBlock:
        if self._shift_ns == 0:
            return block
        return replace(block, t_ns=block.t_ns + self._shift_ns)

    def _in_order(self, block: EventBlock) -> EventBlock:
        """Sort a block's events, and leave out those that come too late."""
        begin = block.t_ns[0] if self._newest_ns is None else self._newest_ns
        steps_back = int((np.diff(block.t_ns) < 0).sum())
        late = block.t_ns < begin
        self._count("events out of order of time were sorted", steps_back)
        self._count("events that came too late were left out", int(late.sum()))
        if late.any():
            block = block[~late]
        return block[np.argsort(block.t_ns, kind="stable")] if steps_back else block

    def _inside(self, block: EventBlock) -> EventBlock:
        width, height = self._camera.resolution
        inside = (block.x < width) & (block.y < height)
        self._count("events outside the sensor were left out", int((~inside).sum()))
        return block if inside.all() else block[inside]

    def _without_islands(self, block: EventBlock) -> EventBlock:
        """Leave out what is before the last jump within a block, or too little to follow it."""
        steps = np.diff(block.t_ns)
        breaks = np.flatnonzero((steps < -DISORDER_NS) | (steps > JUMP_NS)) + 1
        if len(breaks) == 0:
            return block
        pieces = np.split(np.arange(len(block)), breaks)
        last = next((piece for piece in pieces[::-1] if len(piece) >= FEWEST_AFTER_GAP), pieces[0])
        self._count("events with stamps that do not fit were left out", len(block) - len(last))
        return block[last]

    def _follow_jump(self, first_ns: int, arrival: float) -> bool:
        """Shift the stamps if they jumped, so that they go on as time has passed."""
        if self._newest_ns is None or self._fits(first_ns + self._shift_ns):
            return False
        before = self._shift_ns
        if self._fits(first_ns + self._clock.shift_ns):
            self._shift_ns = self._clock.shift_ns
        else:
            passed = max(round((arrival - self._arrival) * 1e9), 1_000_000)
            self._shift_ns = self._clock.shift_ns = self._newest_ns + passed - first_ns
        jump = (before - self._shift_ns) / 1e9
        log.warning("the %s camera's clock jumped by %+.3f s; time goes on", self._name, jump)
        return True

    def _fits(self, t_ns: int) -> bool:
        assert self._newest_ns is not None
        return -DISORDER_NS <= t_ns - self._newest_ns <= JUMP_NS

    def _count(self, kind: str, number: int) -> None:
        if number:
            if not self.faults[kind]:
                log.warning("%s: %s", self._name, kind)
            self.faults[kind] += number


class Repair:
    """Repairs both cameras' events, and finds the offset of their clocks and watches it.

    Clocks that are synchronised agree, or differ by the `right_offset` seconds that are corrected
    later; others are aligned by the events' time of arrival, which is good to some milliseconds.
    """

    def __init__(self, rig: StereoRig, right_offset: float = 0.0) -> None:
        clock = Clock()
        self._left = CameraRepair("left", rig.left, clock)
        self._right = CameraRepair("right", rig.right, clock)
        self._alignment = ClockAlignment(round(right_offset * 1e9))

    @property
    def faults(self) -> Faults:
        """Kinds of faults and numbers of events, both cameras'."""
        return self._left.faults + self._right.faults

    def __call__(self, packet: Packet) -> tuple[EventBlock, EventBlock, bool]:
        """Return the events that can be used, and whether data is missing before them."""
        right = self._alignment.aligned(packet)
        left, left_jumped = self._left(packet.left, packet.arrival)
        right, right_jumped = self._right(right, packet.arrival)
        if left_jumped or right_jumped:
            self._alignment.begin_again()
        return left, right, packet.after_gap or left_jumped or right_jumped


class ClockAlignment:
    """Aligns the right camera's clock with the left one's, by the least delays of arrival.

    Its stamps are left `known_ns` late, nanoseconds.
    """

    def __init__(self, known_ns: int) -> None:
        self._known_ns = known_ns
        self._least: dict[str, int] = {}
        self._began = 0.0
        self._shift_ns: int | None = None
        self._usual_ns: int | None = None

    def aligned(self, packet: Packet) -> EventBlock:
        """Return the right camera's events on the left one's clock."""
        if packet.is_played:
            return packet.right
        for name, block in (("left", packet.left), ("right", packet.right)):
            if len(block):
                delay = round(packet.arrival * 1e9) - int(block.t_ns[-1])
                self._least[name] = min(self._least.get(name, delay), delay)
        if len(self._least) == 2:
            self._watch(self._least["left"] - self._least["right"], packet.arrival)
        if not self._shift_ns:
            return packet.right
        return replace(packet.right, t_ns=packet.right.t_ns - self._shift_ns)

    def begin_again(self) -> None:
        """Forget the delays so far: the clocks jumped."""
        self._least, self._usual_ns = {}, None

    def _watch(self, offset_ns: int, arrival: float) -> None:
        """Follow the right clock's lead over the left one."""
        if self._shift_ns is None:
            is_common = abs(offset_ns - self._known_ns) <= LARGEST_DELAY_NS
            self._shift_ns = 0 if is_common else offset_ns - self._known_ns
            self._began = arrival
            if not is_common:
                log.warning(
                    "the cameras' clocks are not synchronised: the right one is %+.3f s ahead;"
                    " aligned by the time of arrival, to some milliseconds: connect their"
                    " synchronisation cable",
                    offset_ns / 1e9,
                )
        if arrival - self._began < SETTLED:
            return
        self._began, self._least = arrival, {}
        if self._usual_ns is None:
            self._usual_ns = offset_ns
        elif abs(offset_ns - self._usual_ns) > DRIFT_NS:
            drift = (offset_ns - self._usual_ns) / 1e6
            log.warning("the cameras' clocks drift: the right one gained %+.1f ms", drift)
            self._usual_ns = offset_ns
