"""Pair two cameras' events, each pushed at its own pace, into batches that cover the same time."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from gpvo.live.raw_events import RawEvents, checked_events
from gpvo.recordings import Events, StereoEvents, StereoRig
from gpvo.recordings.streams import EventBlock

log = logging.getLogger("gpvo.live")

NEVER, ALWAYS = int(np.iinfo(np.int64).min), int(np.iinfo(np.int64).max)
LONGEST_NS = 2**62
"""Nobody is more patient, nanoseconds."""


class _Side:
    """Checked events of one camera that are in no batch yet."""

    def __init__(self) -> None:
        self.waiting: list[EventBlock] = []
        self.newest_ns = NEVER
        self.late = 0

    def add(self, block: EventBlock, begin_ns: int) -> None:
        """Add events; those before `begin_ns` come too late."""
        if len(block) == 0:
            return
        self.newest_ns = int(block.t_ns[-1])
        first = int(np.searchsorted(block.t_ns, begin_ns))
        self.late += first
        if first < len(block):
            self.waiting.append(block[first:])

    def first_ns(self) -> int:
        """Return the stamp of the first event that waits; ALWAYS without any."""
        return int(self.waiting[0].t_ns[0]) if self.waiting else ALWAYS

    def take(self, stop_ns: int, start_ns: int) -> Events:
        """Take the events before `stop_ns`, in seconds since `start_ns`."""
        taken = []
        while self.waiting and self.waiting[0].t_ns[0] < stop_ns:
            block = self.waiting[0]
            split = int(np.searchsorted(block.t_ns, stop_ns))
            taken.append(block[:split])
            self.waiting[:1] = [block[split:]] if split < len(block) else []
        return Events.concatenate(
            Events(part.x, part.y, (part.t_ns - start_ns) / 1e9, part.polarity) for part in taken
        )


class StereoPairing:
    """Batches of two streams; see `LiveOdometry` for the parameters.

    A batch ends with the newest event of the camera that is behind, as more may come at its time.

    Attributes
    ----------
    start_ns
        Absolute stamp of t = 0, the first event of either camera; None before.
    """

    def __init__(self, rig: StereoRig, patience: float) -> None:
        self._cameras = {"left": rig.left, "right": rig.right}
        self._sides = {"left": _Side(), "right": _Side()}
        self._patience_ns = LONGEST_NS if np.isinf(patience) else round(patience * 1e9)
        self.start_ns: int | None = None
        self._stop_ns, self._waits = NEVER, True
        self._behind: str | None = None

    @property
    def late(self) -> int:
        """Number of events that came after their time had been given up."""
        return sum(side.late for side in self._sides.values())

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest event of either camera."""
        return max(side.newest_ns for side in self._sides.values())

    def push(self, left: RawEvents, right: RawEvents) -> StereoEvents | None:
        """Add events of both cameras; return the batch that they complete, None if there is none.

        Raises
        ------
        InputError
            If they cannot be used; none of them is added.
        """
        blocks = {
            name: checked_events(events, name, self._cameras[name], self._sides[name].newest_ns)
            for name, events in (("left", left), ("right", right))
        }
        for name, side in self._sides.items():
            side.add(blocks[name], self._stop_ns)
        return self._batch(self._complete_ns())

    def end(self) -> StereoEvents | None:
        """Return all that waits as the last batch; what comes next follows time without data."""
        newest_ns = self.newest_ns
        batch = self._batch(newest_ns + 1)
        self._waits = True
        if batch is None or self.start_ns is None:
            return None
        # As short after the newest event as a recording that ends with it.
        stop = float(np.nextafter((newest_ns - self.start_ns) / 1e9, np.inf))
        return replace(batch, stop=stop)

    @property
    def _begin_ns(self) -> int:
        """Stamp of the first event that waits; ALWAYS without any."""
        return min(side.first_ns() for side in self._sides.values())

    def _complete_ns(self) -> int:
        """Return the time before which no event is waited for, nanoseconds."""
        left, right = (side.newest_ns for side in self._sides.values())
        complete, patient = min(left, right), max(left, right) - self._patience_ns
        is_given_up = patient > max(complete, self._begin_ns)
        self._say_who_is_behind(("left" if left < right else "right") if is_given_up else None)
        return patient if is_given_up else complete

    def _say_who_is_behind(self, name: str | None) -> None:
        if name is not None and name != self._behind:
            seconds = self._patience_ns / 1e9
            log.warning("no events of the %s camera for %g s: going on without", name, seconds)
        elif name is None and self._behind is not None:
            log.warning("the %s camera's events are back", self._behind)
        self._behind = name

    def _batch(self, stop_ns: int) -> StereoEvents | None:
        """Return the batch of the events before `stop_ns`; None if it would not begin before."""
        begin_ns = self._begin_ns if self._waits else self._stop_ns
        if begin_ns >= stop_ns:
            return None
        if self.start_ns is None:
            self.start_ns = begin_ns
        start, stop = ((t_ns - self.start_ns) / 1e9 for t_ns in (begin_ns, stop_ns))
        left, right = (side.take(stop_ns, self.start_ns) for side in self._sides.values())
        self._stop_ns, self._waits = stop_ns, False
        return StereoEvents(start, stop, left, right)
