"""The cameras' clocks: apart from the start, or drifting apart.

Disparities are wrong then by the motion in the image meanwhile, all in the same way, so that the
covariance does not know it: such a run is failed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from gpvo.faults.fault import Fault
from gpvo.recordings import StereoEvents, StereoRig
from gpvo.recordings.checks.clock_offset import ClockOffset
from gpvo.recordings.checks.row_rates import RowRates

REMEMBERED = 4.0
"""Seconds of events that are compared."""
SHORTEST = 1.5
"""Seconds of them that tell an offset."""
PERIOD, LATER = 0.5, 2.0
"""Seconds from one look to the next, before and after two of them agreed."""
SAME = 0.003
"""Seconds by which two looks at one offset differ, at most."""
EARLY = 2
"""How many times as uncertain looks count before there are REMEMBERED seconds: they share most of
their events, so that two that are off by chance agree."""
JUDGED = 2 * REMEMBERED
"""Seconds whose looks are judged together: in a long recording some are off by chance."""


class ClockWatch:
    """Compares the courses of the cameras' events; see `clock_offset`.

    Attributes
    ----------
    latest
        Offset as found last; None for no clear one.
    """

    def __init__(self, rig: StereoRig) -> None:
        self.latest: ClockOffset | None = None
        self._rates, self._next = RowRates(rig, REMEMBERED), 0.0
        self._looks = deque[tuple[float, ClockOffset]]()
        self._said: ClockOffset | None = None

    def see(self, batch: StereoEvents) -> Iterator[Fault]:
        """Look at the next events; yield what is wrong once two looks agree."""
        self._rates.add(batch)
        if batch.stop < self._next or self._rates.seconds < SHORTEST:
            return
        before, self.latest = self.latest, self._rates.offset()
        agree = _agree(before, self.latest)
        self._next = batch.stop + (LATER if agree else PERIOD)
        if self.latest is not None:
            self._looks.append((batch.stop, self.latest))
        while self._looks and self._looks[0][0] < batch.stop - JUDGED:
            self._looks.popleft()
        if agree and self.latest is not None:
            yield from self._judge(self.latest)

    def _judge(self, found: ClockOffset) -> Iterator[Fault]:
        steady = _median([look for _, look in self._looks])
        if self._said is None and self._doubted(steady).is_apart:
            self._said = steady
            yield _apart(steady, self._rates.start)
        elif self._said is not None and _differ(self._said, found):
            yield _drift(self._said, found, self._rates.start)

    def _doubted(self, found: ClockOffset) -> ClockOffset:
        """Return an offset with the deviation that it has as long as events are few."""
        is_early = self._rates.seconds < REMEMBERED - PERIOD
        return ClockOffset(found.seconds, (EARLY if is_early else 1) * found.deviation)


def _median(looks: Sequence[ClockOffset]) -> ClockOffset:
    """Return the median of looks at one offset, as certain as one: they share events."""
    seconds, deviation = np.median(looks, axis=0).tolist()
    return ClockOffset(seconds, deviation)


def _agree(before: ClockOffset | None, found: ClockOffset | None) -> bool:
    return bool(before and found and abs(found.seconds - before.seconds) <= SAME)


def _differ(before: ClockOffset, now: ClockOffset) -> bool:
    """Return whether two offsets differ beyond doubt, as `ClockOffset.is_apart` does from 0."""
    return bool(abs(now.seconds - before.seconds) > 3 * np.hypot(before.deviation, now.deviation))


def _apart(found: ClockOffset, t: float) -> Fault:
    return Fault(
        "clocks apart",
        t,
        f"the right camera's stamps are {found} late: its events follow the left one's by that"
        " time; synchronise the clocks, or correct it by gpvo run --right-offset auto, or gpvo live"
        f" --right-offset {found.seconds:.3f}",
        numbers={"offset_s": found.seconds, "deviation_s": found.deviation},
        fails=True,
    )


def _drift(before: ClockOffset, now: ClockOffset, t: float) -> Fault:
    return Fault(
        "clocks drift",
        t,
        f"the cameras' clocks drift: the right one's stamps were {before} late and are"
        f" {now} now; synchronise them by hardware",
        numbers={"offset_before_s": before.seconds, "offset_s": now.seconds},
        fails=True,
    )
