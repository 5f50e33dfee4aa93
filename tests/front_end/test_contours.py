"""Adaptive clusters end when contours have moved by the same distance, whatever the speed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gpvo.config import ClusteringConfig
from gpvo.events import StereoCluster, cluster_events
from gpvo.events.contours import BLOCK, events_until_thick
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig

WIDTH, HEIGHT = 64, 48
LENS = Camera((WIDTH, HEIGHT), np.array([20.0, 20, 32, 24]), "none", np.zeros(4), np.eye(3))
RIG = StereoRig(LENS, LENS, 20.0, (32.0, 24.0), 0.1)
CONTOURS = np.array([0, 20, 40])
"""Initial columns of three upright contours."""


def moving_contours(speed: float, duration: float = 1.0) -> Events:
    """Simulate upright contours that move right by `speed` pixels per second and wrap around."""
    steps = int(speed * duration)
    column = (CONTOURS[None, :, None] + np.arange(steps)[:, None, None]) % WIDTH
    x, y, t = np.broadcast_arrays(
        column, np.arange(HEIGHT), np.arange(steps)[:, None, None] / speed
    )
    size = x.size
    return Events(
        x.ravel().astype(np.uint16), y.ravel().astype(np.uint16), t.ravel(), np.ones(size, bool)
    )


def clusters(left: Events, right: Events, thickness: float) -> list[StereoCluster]:
    config = ClusteringConfig(window=10.0, max_events=10**6, max_thickness=thickness)
    return list(cluster_events([StereoEvents(0.0, 1.0, left, right)], RIG, config))


def thickness(x: NDArray, y: NDArray) -> float:
    """Compute twice the area over the perimeter by its definition."""
    painted = np.zeros((HEIGHT // BLOCK + 2, WIDTH // BLOCK + 2), int)
    painted[y // BLOCK + 1, x // BLOCK + 1] = 1
    perimeter = sum(np.abs(np.diff(painted, axis=axis)).sum() for axis in (0, 1))
    return float(2 * BLOCK * painted.sum() / perimeter)


@given(st.integers(0, 2**32), st.floats(0.5, 8.0))
@settings(deadline=None, max_examples=50)
def test_the_last_event_makes_contours_thick(seed: int, wanted: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.integers(WIDTH, size=1500).astype(np.uint16)
    y = rng.integers(HEIGHT, size=1500).astype(np.uint16)
    count = events_until_thick(x, y, (WIDTH, HEIGHT), wanted)
    if count <= len(x):
        assert thickness(x[:count], y[:count]) >= wanted
    for shorter in range(1, min(count, len(x) + 1), 97):
        assert thickness(x[:shorter], y[:shorter]) < wanted


@pytest.mark.parametrize("speed", [50.0, 200.0, 1000.0])
def test_contours_move_equally_far_at_any_speed(speed: float) -> None:
    events = moving_contours(speed)
    first = clusters(events, events, 4.5)[0]
    assert 4.0 <= (first.stop - first.start) * speed <= 6.0


def test_the_faster_camera_ends_both() -> None:
    slow, fast = moving_contours(50.0), moving_contours(400.0)
    first = clusters(slow, fast, 4.5)[0]
    assert (first.start, first.stop) == (0.0, clusters(fast, fast, 4.5)[0].stop)
    for image in (first.left, first.right):
        times = image.events().t
        assert times.min() >= first.start and times.max() < first.stop


def test_a_hot_pixel_and_gaps_hardly_count() -> None:
    events = moving_contours(200.0)
    every_second = events[(events.x + events.y) % 2 == 0]
    hot = Events(
        np.full(1000, 60, np.uint16),
        np.full(1000, 10, np.uint16),
        np.linspace(0, 0.999, 1000),
        np.ones(1000, bool),
    )
    both = Events.concatenate([every_second, hot])
    both = both[np.argsort(both.t, kind="stable")]
    stops = [clusters(side, side, 4.5)[0].stop for side in (events, both)]
    assert abs(stops[0] - stops[1]) * 200.0 <= 2.0
