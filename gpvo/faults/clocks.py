"""The cameras' clocks: apart from the start, or drifting apart."""

from __future__ import annotations

from collections.abc import Iterator

from gpvo.faults.fault import Fault
from gpvo.faults.rates import EventRates
from gpvo.recordings.checks.clock_offset import clock_offset

PERIOD = 500
"""Milliseconds from one look at the rates to the next."""
SHORTEST = 1500
"""Milliseconds of rates that tell an offset."""
SAME = 0.003
"""Seconds by which two looks at one offset differ, at most."""


class ClockWatch:
    """Compares the course of the cameras' event rates; see `clock_offset`.

    Attributes
    ----------
    latest
        Seconds by which the right camera's stamps are late, as found last; None for no clear one.
    """

    def __init__(self) -> None:
        self.latest: float | None = None
        self._next = 0
        self._said: float | None = None

    def see(self, rates: EventRates) -> Iterator[Fault]:
        """Look at the latest rates; yield what is wrong once two looks agree."""
        if rates.stop < self._next or rates.counts.shape[1] < SHORTEST:
            return
        self._next = rates.stop + PERIOD
        before, self.latest = self.latest, clock_offset(*rates.counts[:, :-1])
        found = self.latest
        if found is None or before is None or abs(found - before) > SAME:
            return
        t = (rates.stop - rates.counts.shape[1]) / 1000
        if self._said is None:
            self._said = found
            yield _apart(found, t)
        elif abs(found - self._said) > SAME:
            yield _drift(self._said, found, t)


def _apart(seconds: float, t: float) -> Fault:
    return Fault(
        "clocks apart",
        t,
        f"the right camera's stamps are {seconds:+.3f} s late: its event rate follows the left"
        " one's by that time; synchronise the clocks, or correct it by --right-offset auto",
        numbers={"offset_s": seconds},
    )


def _drift(before: float, now: float, t: float) -> Fault:
    return Fault(
        "clocks drift",
        t,
        f"the cameras' clocks drift: the right one's stamps were {before:+.3f} s late and are"
        f" {now:+.3f} s now; synchronise them by hardware",
        numbers={"offset_before_s": before, "offset_s": now},
    )
