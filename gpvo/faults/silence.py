"""A camera that sends nothing, while the other one does or not."""

from __future__ import annotations

from collections.abc import Iterator

from gpvo.faults.fault import Fault
from gpvo.recordings import Events, StereoEvents

LONGEST = 0.2
"""Longest time without events of a camera that works, seconds; all have noise."""
LATE = 0.5
"""Longest time after which the second camera starts, seconds."""
ALIVE = 100
"""Number of events in that time that show that the other camera works."""


class Silence:
    """Finds times without events of one camera, or of both.

    Attributes
    ----------
    silences
        (start, stop) in seconds of those so far: of left, right and both.
    """

    def __init__(self) -> None:
        self.silences: dict[str, list[tuple[float, float]]] = {"left": [], "right": [], "both": []}
        self.begin_again()

    def begin_again(self) -> None:
        """Take the time before the next events for none without events."""
        self._latest: dict[str, float] = {}
        self._others = {"left": 0, "right": 0}
        self._start: float | None = None

    def see(self, batch: StereoEvents) -> Iterator[Fault]:
        """Look at the next events; yield what is wrong."""
        if self._start is None:
            self._start = batch.start
        both = {"left": batch.left, "right": batch.right}
        since = {side: self._latest.get(side, self._start) for side in both}
        for side, other in (("left", "right"), ("right", "left")):
            begin = _begin(both[side], batch.stop)
            self._others[side] += len(both[other].between(since[side], begin))
            silent = begin - since[side] >= (LONGEST if side in self._latest else LATE)
            if silent and self._others[side] >= ALIVE:
                self._note(side, since[side], begin)
                yield _one(side, other, since[side])
            if len(both[side]):
                self._latest[side], self._others[side] = float(both[side].t[-1]), 0
        first = min(_begin(events, batch.stop) for events in both.values())
        if self._latest and first - max(since.values()) >= LONGEST:
            self._note("both", max(since.values()), first)
            yield _both(max(since.values()))

    def _note(self, side: str, start: float, stop: float) -> None:
        """Keep a silence, or how long one lasts that is known."""
        known = self.silences[side]
        if known and known[-1][0] == start:
            known.pop()
        known.append((start, stop))


def _begin(events: Events, stop: float) -> float:
    """Time of the first event; the end of the batch if there is none."""
    return float(events.t[0]) if len(events) else stop


def _one(side: str, other: str, t: float) -> Fault:
    return Fault(
        f"{side} camera silent",
        t,
        f"the {side} camera sends no events, the {other} one does; check the {side} camera's"
        " power, cable and topic",
    )


def _both(t: float) -> Fault:
    return Fault(
        "no events",
        t,
        "no events of either camera; those at rest have noise, so that data is missing unless they"
        " are simulated: check cables, driver and disk. The motion is guessed until events come"
        " again, or taken for none if they faded out",
    )
