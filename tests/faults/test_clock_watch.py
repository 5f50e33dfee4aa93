"""Looks at the clocks' offset are judged together: one that is off by chance fails no run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from gpvo.faults.clocks import JUDGED, PERIOD, ClockWatch
from gpvo.faults.fault import Fault
from gpvo.recordings import Events, StereoEvents
from gpvo.recordings.checks.clock_offset import ClockOffset
from gpvo.simulation import SimulationConfig

Said = Callable[[Sequence[float]], list[tuple[float, Fault]]]

DEVIATION = 0.0025
STEP = 0.25


class Rates:
    """What `RowRates` would find, one look after the other."""

    seconds, start = 4.0, 0.0

    def __init__(self, looks: Sequence[float]) -> None:
        self._looks = iter(looks)

    def add(self, batch: StereoEvents) -> None:
        """Need no events."""

    def offset(self) -> ClockOffset:
        """Return the next look; the last one comes again and again."""
        self._last = next(self._looks, getattr(self, "_last", 0.0))
        return ClockOffset(self._last, DEVIATION)


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> Said:
    """Return the times at which something is said of a series of looks."""

    def times(looks: Sequence[float]) -> list[tuple[float, Fault]]:
        watch = ClockWatch(SimulationConfig().rig)
        monkeypatch.setattr(watch, "_rates", Rates(looks))
        found = []
        for start in np.arange(0.0, 60.0, STEP).tolist():
            batch = StereoEvents(start, start + STEP, Events.empty(0), Events.empty(0))
            found += [(batch.stop, fault) for fault in watch.see(batch)]
        return found

    return times


def test_two_looks_that_are_off_in_a_long_recording_say_nothing(said: Said) -> None:
    for normal in (1, 2, 5, 9):
        assert said([*[0.0] * (1 + normal), -0.008, -0.008, *[0.0] * 20]) == []


def test_an_offset_from_the_start_is_said_at_the_second_look(said: Said) -> None:
    ((t, fault),) = said([0.008])
    assert fault.kind == "clocks apart" and t <= STEP + PERIOD
    assert fault.numbers["offset_s"] == pytest.approx(0.008)


def test_the_first_looks_share_their_events_and_must_be_far_off(
    said: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Rates, "seconds", 2.0)
    assert said([0.0097, 0.0096, -0.0046, *[0.0] * 20]) == [] and said([0.008]) == []
    ((t, fault),) = said([0.02])
    assert fault.kind == "clocks apart" and t <= STEP + PERIOD


def test_an_offset_from_later_on_is_said_once_most_looks_have_it(said: Said) -> None:
    ((t, fault),) = said([*[0.0] * 5, 0.02])
    assert fault.kind == "clocks apart" and t <= 10.0 + JUDGED
