"""Faults of streams of events whose rates are known: found once, and never in a sound stream."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gpvo.faults import FaultWatch
from gpvo.faults.doubled import repeated
from gpvo.recordings import Events, Recording, StereoEvents
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.checks.clock_offset import BIN
from gpvo.recordings.checks.row_rates import RowRates
from gpvo.recordings.event_batches import stereo_batches
from gpvo.recordings.right_offset import ShiftedRecording, found_offset, with_right_offset

DURATION = 4.0
SIZE = (240, 180)


def events(seed: int, late: float = 0.0, duration: float = DURATION) -> Events:
    """Make events of a camera that shakes: the rate follows the motion, `late` seconds later."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1e-3)
    course = np.random.default_rng(1).gamma(1.0, 1.0, len(t) // 20 + 1)
    rate = 20 + 60 * np.interp(t - late, np.arange(len(course)) * 0.02, course)
    count = rng.poisson(rate)
    times = np.repeat(t, count) + rng.uniform(0, 1e-3, count.sum())
    pixels = (rng.integers(0, side, len(times)).astype(np.uint16) for side in SIZE)
    return Events(*pixels, np.sort(times).round(6), rng.random(len(times)) < 0.5)


def batches(left: Events, right: Events, length: float = 0.1) -> Iterator[StereoEvents]:
    edges = np.arange(0.0, max(left.t[-1], right.t[-1]) + length, length).tolist()
    for start, stop in pairwise(edges):
        yield StereoEvents(start, stop, left.between(start, stop), right.between(start, stop))


def found(left: Events, right: Events, length: float = 0.1) -> dict[str, float]:
    """Return the kinds of faults and their times."""
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in batches(left, right, length):
        watch.see_events(batch)
    return {fault.kind: fault.t for fault in watch.faults}


class Streams(Recording):
    """A recording in memory."""

    def __init__(self, left: Events, right: Events) -> None:
        self.path, self.start_ns, self.duration = Path("streams"), 0, DURATION
        self.rig, self._left, self._right = UNKNOWN_RIG, left, right

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = max(start, 0.0), min(stop, DURATION)
        sides = (iter([side.between(start, stop)]) for side in (self._left, self._right))
        return stereo_batches(*sides, start, stop, 0.1)


def without(stream: Events, start: float, stop: float) -> Events:
    return stream[(stream.t < start) | (stream.t >= stop)]


@pytest.mark.parametrize("length", [0.1, 0.013])
def test_nothing_is_said_of_a_sound_stream(length: float) -> None:
    assert found(events(1), events(2), length) == {}


@pytest.mark.parametrize("length", [0.1, 0.013])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_camera_that_dies_is_named_with_its_time(side: str, length: float) -> None:
    streams = {"left": events(1), "right": events(2)}
    streams[side] = without(streams[side], 1.5, np.inf)
    assert found(**streams, length=length) == {f"{side} camera silent": pytest.approx(1.5, abs=0.1)}


@pytest.mark.parametrize("length", [0.1, 0.013])
def test_a_time_without_events_is_said_once(length: float) -> None:
    left, right = (without(without(events(k), 1.0, 1.5), 2.0, 3.0) for k in (1, 2))
    assert found(left, right, length) == {"no events": pytest.approx(1.0, abs=0.1)}


@pytest.mark.parametrize("on_purpose", [True, False])
def test_events_that_were_left_out_on_purpose_are_no_silence(on_purpose: bool) -> None:
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in batches(events(1), events(2)):
        if on_purpose and batch.start < 2.0 <= batch.stop:
            watch.see_events(None)
        if not 1.0 < batch.start < 2.0:
            watch.see_events(batch)
    assert [fault.kind for fault in watch.faults] == ["no events"] * (not on_purpose)


def test_a_short_silence_is_none() -> None:
    left, right = (without(events(k), 1.0, 1.15) for k in (1, 2))
    assert found(left, right) == {}


@pytest.mark.parametrize("late", [-0.02, 0.012, 0.05, 0.3])
def test_clocks_that_are_apart_are_found_and_measured(
    late: float, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, logger="gpvo.faults"):
        assert list(found(events(1), events(2, late))) == ["clocks apart"]
    (line,) = caplog.messages
    offset = float(line.partition("stamps are ")[2].partition(" s")[0])
    assert offset == pytest.approx(late, abs=0.0005) and "--right-offset auto" in line


@pytest.mark.parametrize("late", [0.0, -0.02, 0.05, 0.3])
def test_a_right_camera_that_is_late_is_corrected_automatically(late: float) -> None:
    recording = Streams(events(1), events(2, late))
    offset = found_offset(recording)
    assert offset is not None and offset.seconds == pytest.approx(late, abs=0.0015)
    corrected = with_right_offset(recording, "auto")
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in corrected.event_batches():
        watch.see_events(batch)
        for side in (batch.left, batch.right):
            assert ((side.t >= batch.start) & (side.t < batch.stop)).all()
    assert not any("clocks" in fault.kind for fault in watch.faults)


@pytest.mark.parametrize("start", [0.0, 1.05])
def test_all_events_of_a_shifted_camera_come_once(start: float) -> None:
    left, right = events(1), events(2)
    shifted = ShiftedRecording(Streams(left, right), 0.25)
    parts = [batch.right for batch in shifted.event_batches(start, 2.0)]
    expected = right.between(start + 0.25, 2.25)
    np.testing.assert_allclose(Events.concatenate(parts).t, expected.t - 0.25, atol=1e-9)


def test_clocks_that_drift_are_said_too() -> None:
    left, right = events(1, duration=14.0), events(2, 0.02, 14.0)
    slow = replace(right, t=right.t * 1.001)
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in batches(left, slow):
        watch.see_events(batch)
    assert [fault.kind for fault in watch.faults] == ["clocks apart", "clocks drift"]


def test_doubled_events_are_named() -> None:
    left, right = events(1), events(2)
    twice = right[np.repeat(np.arange(len(right)), 2)]
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in batches(left, twice):
        watch.see_events(batch)
    (fault,) = watch.faults
    assert fault.kind == "doubled events" and "100% of the right" in fault.text and not fault.harms
    assert repeated(left[:400]) == 0


@pytest.mark.parametrize("length", [0.1, 0.013])
def test_what_is_said_has_its_numbers(length: float) -> None:
    """Offset, silences and rates, for programs that read metrics.json."""
    late = events(2, 0.05)
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in batches(events(1), late, length):
        watch.see_events(batch)
    (fault,) = watch.faults
    numbers = json.loads(json.dumps(watch.numbers))
    assert fault.numbers["offset_s"] == pytest.approx(0.05, abs=0.003)
    assert numbers["clock_offset_s"] == pytest.approx(0.05, abs=0.003)
    assert 0 < numbers["clock_offset_deviation_s"] < 0.005
    assert numbers["left_events_per_s"] == pytest.approx(len(events(1)) / DURATION, rel=0.01)
    assert numbers["right_events_per_s"] == pytest.approx(len(late) / DURATION, rel=0.02)


@pytest.mark.parametrize("length", [0.1, 0.013])
def test_all_silences_have_their_times(length: float) -> None:
    left, right = (without(events(k), 1.0, 1.5) for k in (1, 2))
    right = without(without(right, 2.0, 2.3), 3.0, 3.4)
    watch = FaultWatch(UNKNOWN_RIG)
    for batch in batches(left, right, length):
        watch.see_events(batch)
    silences = watch.numbers["silences_s"]
    np.testing.assert_allclose(silences["both"], [[1.0, 1.5]], atol=0.01)
    np.testing.assert_allclose(silences["right"], [[2.0, 2.3], [3.0, 3.4]], atol=0.01)
    assert silences["left"] == []


@pytest.mark.parametrize("length", [0.1, 0.0333, 0.0004])
@pytest.mark.parametrize("remembered", [0.25, 4.0])
def test_rates_are_the_same_for_batches_of_any_length(
    length: float, remembered: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpvo.recordings.checks.row_rates.MOST", 10**9)
    left, right = (events(k).between(0.0, 0.8) for k in (1, 2))
    rates = RowRates(UNKNOWN_RIG, remembered)
    for batch in batches(left, right, length):
        rates.add(batch)
    stop = rates.stop - 1
    known = min(stop, round(remembered / BIN) - (remembered < 0.8))
    for found, side in zip(rates.counts(), (left, right), strict=True):
        edges = np.arange(stop + 1)
        for band, on in ((0, False), (5, True)):
            mine = side[(side.y // 16 == band) & (side.polarity == on)]
            expected = np.histogram(mine.t / BIN, edges)[0][-known:]
            # An event at a border may count for either side of it.
            course = found[2 * band + on][-known:].cumsum()
            np.testing.assert_allclose(course, expected.cumsum(), atol=1)


def test_of_many_events_some_are_counted_for_all() -> None:
    side = events(1)
    many = Events(*(np.repeat(column, 40) for column in (side.x, side.y, side.t, side.polarity)))
    few = RowRates(UNKNOWN_RIG, 4.0)
    for batch in batches(many, side):
        few.add(batch)
    total = few.counts().sum(axis=(1, 2))
    assert total[0] == pytest.approx(40 * total[1], rel=0.01)


def test_after_a_long_time_without_data_only_the_new_is_known() -> None:
    rates = RowRates(UNKNOWN_RIG, 1.0)
    side = events(1)
    for start, stop in ((0.0, 0.5), (0.5, 90.0), (90.0, 90.4)):
        late = replace(side, t=side.t + 90.0)
        both = side.between(start, min(stop, 0.5)), late.between(start, stop)
        one = Events.concatenate(both)
        rates.add(StereoEvents(start, stop, one, one))
    assert rates.seconds == pytest.approx(1.0) and rates.start == pytest.approx(89.4)
    assert rates.counts()[0].sum() == pytest.approx(len(late.between(90.0, 90.4)), rel=0.02)
