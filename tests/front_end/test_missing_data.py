"""Silence is rest where the events faded out, and missing data where they were cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.events import ClusterEvents, StereoCluster
from gpvo.recordings import Events
from gpvo.tracking.missing_data import END, MissingData, events_at_end

STOP = 0.25
NOTHING = ClusterEvents((), np.zeros((1, 1, 2), np.float32), (80, 60))
SILENT = StereoCluster(0.0, STOP, NOTHING, NOTHING)


def cluster(t: np.ndarray) -> StereoCluster:
    """Make a cluster with events of both cameras at times (N,), seconds."""
    pixels = np.zeros(len(t), np.uint16)
    events = replace(NOTHING, parts=(Events(pixels, pixels, t, np.ones(len(t), bool)),))
    return StereoCluster(0.0, STOP, events, events)


def steady(rate: float, end: float = STOP) -> StereoCluster:
    return cluster(np.arange(0.0, end, 1 / rate))


def is_missing_after(*clusters: StereoCluster) -> bool:
    missing = MissingData()
    assert not any(map(missing.is_in, clusters))
    return missing.is_in(SILENT)


@given(st.floats(1e3, 1e5), st.floats(0.02, STOP))
def test_a_stream_that_is_cut_ends_among_many_events(rate: float, end: float) -> None:
    assert events_at_end(steady(rate, end)) == pytest.approx(2 * rate * END, abs=4)
    assert is_missing_after(steady(rate), steady(rate, end))


@given(st.floats(3e5, 1e6), st.floats(0.15, STOP))
@settings(max_examples=20)
def test_a_camera_that_comes_to_rest_fades_out(rate: float, seconds: float) -> None:
    """At constant deceleration the way that is left, and its events, shrink with its square."""
    count = int(rate * seconds / 2)
    stops = cluster(seconds * (1 - np.sqrt(np.arange(count, 0, -1) / count)))
    last = seconds / np.sqrt(count)  # the last event comes so long before the rest
    expected = count * ((END + last) / seconds) ** 2
    assert events_at_end(stops) == pytest.approx(2 * expected, abs=4)
    assert not is_missing_after(*[steady(rate)] * 3, stops)


def test_what_a_silence_is_does_not_change_while_it_lasts() -> None:
    missing = MissingData()
    noise = replace(SILENT, left=replace(NOTHING, left_out=(3, 0)))
    missing.is_in(steady(1e4, 0.1))
    assert not missing.is_in(noise)
    assert [missing.is_in(SILENT) for _ in range(3)] == [True] * 3


def test_a_stream_without_any_event_before_has_missing_data() -> None:
    assert MissingData().is_in(SILENT)


@pytest.mark.parametrize("left_out", [(3, 0), (0, 3)])
def test_events_that_the_noise_filter_left_out_are_no_silence(left_out: tuple[int, int]) -> None:
    assert SILENT.is_silent
    assert not replace(SILENT, right=replace(NOTHING, left_out=left_out)).is_silent
