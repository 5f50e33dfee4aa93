"""The way of contours between two events of a pixel is found from the events and their motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.events import ClusterEvents
from gpvo.recordings import Events
from gpvo.tracking import event_spacing
from gpvo.tracking.event_spacing import FARTHEST, FEWEST, MEMORY, EventSpacing, repeated_events
from gpvo.tracking.event_sums import Flow

WIDTH, HEIGHT = 40, 30
seeds = st.integers(0, 2**32)


def cluster(events: Events, parts: int = 1) -> ClusterEvents:
    table = np.dstack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))).astype(np.float32)
    cuts = np.linspace(0, len(events), parts + 1).astype(int)
    pieces = tuple(events[a:b] for a, b in pairwise(cuts))
    return ClusterEvents(pieces, table, (WIDTH, HEIGHT))


def random_events(seed: int, count: int) -> Events:
    rng = np.random.default_rng(seed)
    x, y = (rng.integers(0, side, count).astype(np.uint16) for side in (WIDTH, HEIGHT))
    return Events(x, y, np.sort(rng.uniform(0, 1, count)), rng.random(count) < 0.5)


def slopes(spacing: float, speed: float, duration: float) -> Events:
    """Every pixel has events of one polarity, between which contours move by the spacing."""
    t = np.arange(0.0, duration, spacing / speed)
    x, y = (side.ravel() for side in np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)))
    rows = [np.tile(column.astype(np.uint16), len(t)) for column in (x, y)]
    return Events(*rows, np.repeat(t, len(x)), np.tile((x + y) % 2 == 0, len(t)))


def flow(speed: float, angle: float) -> Flow:
    return np.full((1, 1, 2), (speed * np.cos(angle), speed * np.sin(angle)), np.float32)


def pairs_one_by_one(events: Events) -> list[tuple[int, int, float]]:
    """Compare the events of each pixel with the one before, without a kernel."""
    last: dict[tuple[int, int], tuple[float, bool]] = {}
    found = []
    columns = events.x.tolist(), events.y.tolist(), events.t.tolist(), events.polarity.tolist()
    for x, y, t, polarity in zip(*columns, strict=True):
        before = last.get((x, y))
        if before is not None and before[1] == polarity:
            found.append((x, y, t - before[0]))
        last[x, y] = t, polarity
    return found


@given(seeds, st.integers(1, 4))
@settings(deadline=None, max_examples=30)
def test_events_are_compared_with_the_last_one_of_their_pixel(seed: int, parts: int) -> None:
    events = random_events(seed, 3000)
    pixel, interval = repeated_events(cluster(events, parts))
    expected = np.array(pairs_one_by_one(events))
    np.testing.assert_array_equal(pixel, expected[:, :2])
    np.testing.assert_allclose(interval, expected[:, 2], rtol=1e-12)


def test_of_many_events_those_of_some_rows_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    events = random_events(1, 3000)
    every, _ = repeated_events(cluster(events))
    monkeypatch.setattr(event_spacing, "ENOUGH", 1000)
    some, _ = repeated_events(cluster(events))
    np.testing.assert_array_equal(some, every[every[:, 1] % 3 == 0])


@given(
    st.floats(0.1, 0.9 * FARTHEST),
    st.floats(5.0, 500.0),
    st.floats(0, 2 * np.pi),
    st.integers(1, 2),
)
@settings(deadline=None, max_examples=30)
def test_the_way_between_events_is_found(
    spacing: float, speed: float, angle: float, side: int
) -> None:
    """At any speed and in any direction, in wider pixels, too; per root of the way shown."""
    duration = 6 * spacing / speed
    found = EventSpacing(side)
    found.follow(cluster(slopes(spacing, speed, duration)), flow(speed / side, angle), duration)
    shown = 6 * spacing / side
    assert found.value == pytest.approx(spacing / side / np.sqrt(shown), rel=1e-5)


def test_it_is_averaged_over_clusters() -> None:
    found = EventSpacing(1)
    found.follow(cluster(slopes(0.5, 50.0, 0.05)), flow(50.0, 0.0), 0.05)
    first = found.value
    found.follow(cluster(slopes(1.0, 50.0, 0.05)), flow(50.0, 0.0), 0.05)
    assert found.value == pytest.approx(first + first / MEMORY)


def test_it_stays_unknown_without_pairs_of_the_same_contour() -> None:
    """Too few pairs, none, some far apart, none that move, or outside the rectified image."""
    events, found = slopes(0.5, 50.0, 0.05), EventSpacing(1)
    few = events.x + WIDTH * events.y.astype(int) < (FEWEST - 1) // 5 + 1
    none = cluster(events)
    nowhere = replace(none, table=np.full_like(none.table, np.nan))
    for seen, motion in (
        (cluster(events[few & (events.t < 0.015)]), flow(50.0, 0.0)),
        (cluster(events[events.t < 0]), flow(50.0, 0.0)),
        (cluster(slopes(1.1 * FARTHEST, 50.0, 0.5)), flow(50.0, 0.0)),
        (none, flow(0.0, 0.0)),
        (nowhere, flow(50.0, 0.0)),
    ):
        found.follow(seen, motion, 0.05)
        assert found.value == 0
    found.follow(none, flow(50.0, 0.0), 0.05)
    assert found.value > 0
