"""Event filters compared with their definitions, and the image of a cluster's event times."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.config import ClusteringConfig
from gpvo.events import ClusterEvents
from gpvo.events.noise_filter import LEAST_HOT, EventFilter
from gpvo.recordings import Events

WIDTH, HEIGHT = 12, 9


def random_events(seed: int, count: int = 300) -> Events:
    rng = np.random.default_rng(seed)
    return Events(
        rng.integers(WIDTH, size=count).astype(np.uint16),
        rng.integers(HEIGHT, size=count).astype(np.uint16),
        np.sort(rng.random(count)),
        rng.random(count) < 0.5,
    )


def filtered(events: Events, **fields: float) -> Events:
    return EventFilter((WIDTH, HEIGHT), ClusteringConfig(**fields))(events)


@given(st.integers(0, 2**32), st.sampled_from([0.005, 0.02, 0.1]))
@settings(deadline=None, max_examples=30)
def test_kept_is_what_has_a_recent_neighbour(seed: int, duration: float) -> None:
    events = random_events(seed)
    x, y = events.x.astype(int), events.y.astype(int)
    expected = []
    for i in range(len(events)):
        distance = np.maximum(np.abs(x[:i] - x[i]), np.abs(y[:i] - y[i]))
        expected.append(bool((events.t[i] - events.t[:i][distance == 1] <= duration).any()))
    np.testing.assert_array_equal(
        filtered(events, background_filter=duration).t, events.t[expected]
    )


@given(st.integers(0, 2**32), st.integers(1, 299))
@settings(deadline=None, max_examples=20)
def test_batches_do_not_matter(seed: int, cut: int) -> None:
    events = random_events(seed)
    fields = {"background_filter": 0.05, "hot_pixel_ratio": 2}
    whole = filtered(events, **fields)
    keep = EventFilter((WIDTH, HEIGHT), ClusteringConfig(**fields))
    parts = Events.concatenate([keep(events[:cut]), keep(events[cut:])])
    np.testing.assert_array_equal(parts.t, whole.t)


@pytest.mark.parametrize("pixel", [(5, 4), (0, 0), (WIDTH - 1, HEIGHT - 1)])
def test_hot_pixel_is_masked_and_no_other(pixel: tuple[int, int]) -> None:
    events = random_events(0, 1000)  # about nine per pixel
    u, v = pixel
    hot = Events(
        np.full(2000, u, np.uint16),
        np.full(2000, v, np.uint16),
        np.linspace(0, 1, 2000),
        np.ones(2000, bool),
    )
    both = Events.concatenate([events, hot])
    both = both[np.argsort(both.t, kind="stable")]
    kept = filtered(both, hot_pixel_ratio=10)
    here = (kept.x == u) & (kept.y == v)
    away = ((events.x != u) | (events.y != v)).sum()
    assert LEAST_HOT <= here.sum() < 200
    assert (~here).sum() == away


def test_without_filters_events_are_untouched() -> None:
    events = random_events(1)
    assert filtered(events) is events


def test_time_surface_grows_with_the_time_of_the_latest_event() -> None:
    surface = np.full((2, 3), -np.inf)
    surface[0] = 2.0, 2.05, 2.1
    image = ClusterEvents(surface, 3).time_surface(2.0, 2.1)
    np.testing.assert_array_equal(image, [[1, 128, 255], [0, 0, 0]])
