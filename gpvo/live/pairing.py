"""Pair two cameras' events, each pushed at its own pace, into batches that cover the same time."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gpvo.errors import InputError
from gpvo.live.raw_events import RawEvents, check_steps, checked_events
from gpvo.recordings import Events, StereoEvents, StereoRig
from gpvo.recordings.streams import EventBlock

log = logging.getLogger("gpvo.live")

NEVER, ALWAYS = int(np.iinfo(np.int64).min), int(np.iinfo(np.int64).max)
LONGEST_NS = 2**62
"""Nobody is more patient, nanoseconds."""
SILENCE_NS = 600 * 10**9
"""Longest time without events of either camera, nanoseconds; those at rest have noise."""


class _Side:
    """Checked events of one camera that are in no batch yet.

    Attributes
    ----------
    waiting
        The events, with corrected stamps.
    newest_ns
        Stamp of the newest event, by the camera's own clock, which is `offset_ns` late.
    late
        Number of events that came after their time had been given up.
    """

    def __init__(self, offset_ns: int = 0) -> None:
        self.waiting: list[EventBlock] = []
        self.newest_ns = NEVER
        self.late = 0
        self.offset_ns = offset_ns

    @property
    def reached_ns(self) -> int:
        """Corrected stamp of the newest event."""
        return self.newest_ns - self.offset_ns

    def __len__(self) -> int:
        return sum(map(len, self.waiting))

    def add(self, block: EventBlock, begin_ns: int) -> None:
        """Add events; those before `begin_ns` come too late."""
        if len(block) == 0:
            return
        self.newest_ns = int(block.t_ns[-1])
        if self.offset_ns:
            block = replace(block, t_ns=block.t_ns - self.offset_ns)
        in_time = _since(block, begin_ns)
        self.late += len(block) - len(in_time)
        if len(in_time):
            self.waiting.append(in_time)

    def first_ns(self) -> int:
        """Return the first stamp that waits, by the camera's own clock; ALWAYS without any."""
        return int(self.waiting[0].t_ns[0]) + self.offset_ns if self.waiting else ALWAYS

    def leave_out(self, begin_ns: int) -> None:
        """Leave out what waits from before `begin_ns`."""
        kept = (_since(block, begin_ns) for block in self.waiting)
        self.waiting = [block for block in kept if len(block)]

    def take(self, stop_ns: int, start_ns: int) -> Events:
        """Take the events before `stop_ns`, in seconds since `start_ns`."""
        taken = []
        while self.waiting and self.waiting[0].t_ns[0] < stop_ns:
            block = self.waiting[0]
            split = int(np.searchsorted(block.t_ns, stop_ns))
            taken.append(block[:split])
            self.waiting[:1] = [block[split:]] if split < len(block) else []
        block = EventBlock.concatenate(taken or [EventBlock.empty()])
        return Events(block.x, block.y, (block.t_ns - start_ns) / 1e9, block.polarity)


def _since(block: EventBlock, begin_ns: int) -> EventBlock:
    """Return the events from a stamp on."""
    if begin_ns <= block.t_ns[0]:
        return block
    return block[int(np.searchsorted(block.t_ns, begin_ns)) :]


def _check_beginning(firsts_ns: list[int]) -> None:
    """Raise InputError if the cameras' first events are too far apart."""
    apart_ns = max(firsts_ns, default=0) - min(firsts_ns, default=0)
    if apart_ns > SILENCE_NS:
        raise InputError(
            f"left and right t: the first events are {apart_ns / 1e9:g} s apart, more than"
            f" {SILENCE_NS / 1e9:g} s; give microseconds of one clock"
        )


class StereoPairing:
    """Batches of two streams; see `LiveOdometry` for the parameters.

    `is_due` is asked, with a batch's stop, seconds, and the number of events of the camera that has
    more, whether it is wanted now; else its events wait for the next one. A batch ends with the
    newest event of the camera that is behind, as more may come at its time. The first one, and that
    after an end, begins with the first event by the cameras' own clocks, as a recording does; what
    is corrected to before it is left out.

    Attributes
    ----------
    start_ns
        Absolute stamp of t = 0, the first event of either camera; None before.
    """

    def __init__(
        self,
        rig: StereoRig,
        patience: float,
        right_offset: float = 0.0,
        is_due: Callable[[float, int], bool] = lambda stop, waiting: True,
    ) -> None:
        self._is_due = is_due
        offset_ns = round(right_offset * 1e9)
        self._rig = rig
        self._sides = {"left": _Side(), "right": _Side(offset_ns)}
        self._patience = patience
        # Corrected, a camera is behind by the offset while both are alive.
        self._patience_ns = LONGEST_NS if np.isinf(patience) else round(patience * 1e9)
        self._patience_ns += abs(offset_ns)
        self.start_ns: int | None = None
        self._stop_ns, self._waits = NEVER, True
        self._behind: str | None = None

    @property
    def late(self) -> int:
        """Number of events that came after their time had been given up."""
        return sum(side.late for side in self._sides.values())

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest event of either camera, by its own clock."""
        return max(side.newest_ns for side in self._sides.values())

    def checked(self, left: RawEvents, right: RawEvents) -> tuple[EventBlock, EventBlock]:
        """Check the next events of both cameras.

        Raises
        ------
        InputError
            If they cannot be used.
        """
        left_side, right_side = self._sides.values()
        blocks = (
            checked_events(left, "left", self._rig.left, left_side.newest_ns),
            checked_events(right, "right", self._rig.right, right_side.newest_ns),
        )
        self._check_silence(*blocks)
        return blocks

    def _check_silence(self, *blocks: EventBlock) -> None:
        """Raise InputError if a time without events comes that takes minutes to guess through."""
        sides = self._sides.values()
        pushed = [(block, side) for block, side in zip(blocks, sides, strict=True) if len(block)]
        firsts = [int(block.t_ns[0]) - side.offset_ns for block, side in pushed]
        if self._waits:
            firsts += [int(side.waiting[0].t_ns[0]) for side in sides if side.waiting]
            _check_beginning(firsts)
        before_ns = min(firsts, default=0) if self._waits else max(s.reached_ns for s in sides)
        for name, side, block in zip(self._sides, sides, blocks, strict=True):
            if len(block) and int(block.t_ns[-1]) - side.offset_ns - before_ns > SILENCE_NS:
                check_steps(block.t_ns, before_ns + side.offset_ns, SILENCE_NS, f"{name} t")

    def push(self, left: EventBlock, right: EventBlock) -> StereoEvents | None:
        """Add events of both cameras; return the batch that they complete, None if there is none.

        They are on the sensor and in order of time.
        """
        for block, side in zip((left, right), self._sides.values(), strict=True):
            side.add(block, self._stop_ns)
        stop_ns = self._complete_ns()
        return self._batch(stop_ns) if self._wants(stop_ns) else None

    def end(self) -> StereoEvents | None:
        """Return all that waits as the last batch; what comes next follows time without data."""
        newest_ns = self.newest_ns
        batch = self._batch(newest_ns + 1)
        self._waits = True
        for side in self._sides.values():
            side.waiting.clear()  # no event of the other camera is of its time
        if batch is None or self.start_ns is None:
            return None
        # As short after the newest event as a recording that ends with it.
        stop = float(np.nextafter((newest_ns - self.start_ns) / 1e9, np.inf))
        return replace(batch, stop=stop)

    def _wants(self, stop_ns: int) -> bool:
        """Whether a batch until then is due; the first one begins the stream."""
        if self._waits or self.start_ns is None:
            return True
        return self._is_due((stop_ns - self.start_ns) / 1e9, max(map(len, self._sides.values())))

    @property
    def _begin_ns(self) -> int:
        """First stamp that waits, by the cameras' own clocks; ALWAYS without any."""
        return min(side.first_ns() for side in self._sides.values())

    def _complete_ns(self) -> int:
        """Return the time before which no event is waited for, nanoseconds."""
        left, right = (side.reached_ns for side in self._sides.values())
        complete, patient = min(left, right), max(left, right) - self._patience_ns
        is_given_up = patient > max(complete, self._begin_ns)
        self._say_who_is_behind(("left" if left < right else "right") if is_given_up else None)
        return patient if is_given_up else complete

    def _say_who_is_behind(self, name: str | None) -> None:
        if name is not None and name != self._behind:
            log.warning(
                "no events of the %s camera for %g s: going on without", name, self._patience
            )
        elif name is None and self._behind is not None:
            log.warning("the %s camera's events are back", self._behind)
        self._behind = name

    def _batch(self, stop_ns: int) -> StereoEvents | None:
        """Return the batch of the events before `stop_ns`; None if it would not begin before."""
        begin_ns = self._begin_ns if self._waits else self._stop_ns
        if begin_ns >= stop_ns:
            return None
        if self._waits:
            for side in self._sides.values():
                side.leave_out(begin_ns)
        if self.start_ns is None:
            self.start_ns = begin_ns
        start, stop = ((t_ns - self.start_ns) / 1e9 for t_ns in (begin_ns, stop_ns))
        left, right = (side.take(stop_ns, self.start_ns) for side in self._sides.values())
        self._stop_ns, self._waits = stop_ns, False
        return StereoEvents(start, stop, left, right)
