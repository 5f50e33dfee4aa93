"""Event filters compared with their definitions, and the image of a cluster's event times."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shown_events import of_surface

from gpvo.config import ClusteringConfig
from gpvo.events import noise_filter as module
from gpvo.events.noise_filter import UNSEEN, EventFilter
from gpvo.events.noise_kernels import LEAST_HOT, SUPPORTERS
from gpvo.events.noise_rate import EXPECTED, WINDOW, passing_share, support_time
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


OFF = {"background_filter": 0.0, "hot_pixel_ratio": 0.0}


def filtered(events: Events, **fields: float) -> Events:
    config = ClusteringConfig.model_validate({**OFF, **fields})
    return EventFilter((WIDTH, HEIGHT), config)(events)


def poisson(rate: float, size: tuple[int, int], duration: float, seed: int = 0) -> Events:
    """Make noise of a rate, events per pixel and second."""
    rng = np.random.default_rng(seed)
    count = rng.poisson(rate * size[0] * size[1] * duration)
    x, y = (rng.integers(side, size=count).astype(np.uint16) for side in size)
    return Events(x, y, np.sort(rng.uniform(0, duration, count)), rng.random(count) < 0.5)


def edge(columns: int, rows: int, duration: float) -> Events:
    """Make an upright edge that moves to and fro over columns, a column every 5 ms."""
    step = np.arange(int(duration / 0.005))
    column = np.abs(step % (2 * columns) - columns) % columns
    t = np.repeat(0.005 * step, rows) + np.tile(1e-6 * np.arange(rows), len(step))
    x, y = np.repeat(column, rows), np.tile(np.arange(rows), len(step))
    return Events(x.astype(np.uint16), y.astype(np.uint16), t, np.ones(len(t), bool))


def together(*parts: Events) -> Events:
    events = Events.concatenate(parts)
    return events[np.argsort(events.t, kind="stable")]


@given(st.integers(0, 2**32), st.sampled_from([0.005, 0.02, 0.1]))
@settings(deadline=None, max_examples=30)
def test_kept_is_what_pixels_around_support(seed: int, duration: float) -> None:
    """Their latest events are recent, and of the same polarity."""
    events = random_events(seed)
    latest: dict[tuple[int, int], tuple[float, bool]] = {}
    expected = []
    for x, y, t, on in zip(
        events.x.tolist(), events.y.tolist(), events.t, events.polarity, strict=True
    ):
        around = [(x + a, y + b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
        known = [latest[pixel] for pixel in around if pixel in latest]
        supporters = sum(t - before <= duration and of == on for before, of in known)
        expected.append(supporters >= SUPPORTERS)
        latest[x, y] = t, on
    np.testing.assert_array_equal(
        filtered(events, background_filter=duration).t, events.t[expected]
    )


@given(st.integers(0, 2**32), st.integers(1, 299))
@settings(deadline=None, max_examples=20)
def test_batches_do_not_matter(seed: int, cut: int) -> None:
    events = random_events(seed)
    fields = {"background_filter": 0.05, "hot_pixel_ratio": 2}
    whole = filtered(events, **fields)
    assert 0 < len(whole) < len(events)
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
    kept = filtered(together(events, hot), hot_pixel_ratio=10)
    here = (kept.x == u) & (kept.y == v)
    away = ((events.x != u) | (events.y != v)).sum()
    assert LEAST_HOT <= here.sum() < 200
    assert (~here).sum() == away


def test_hot_pixel_that_calms_down_is_forgotten() -> None:
    """Of a pixel that is hot for a second, events a second and more later stay."""
    size, calm = (32, 32), poisson(3.0, (32, 32), 4.0)
    t = np.linspace(0, 1, 5000)
    here = np.full(len(t), 16, np.uint16)
    hot = Events(here, here, t, np.ones(len(t), bool))
    config = ClusteringConfig.model_validate({**OFF, "hot_pixel_ratio": 10})
    noise_filter = EventFilter(size, config)
    kept = noise_filter(together(calm, hot))
    assert len(kept.between(2.0, 4.0)) == len(calm.between(2.0, 4.0))
    background, of_hot_pixel = noise_filter.left_out(np.inf)
    assert len(hot) - 1000 < of_hot_pixel < len(hot) + 20
    assert background == 0


def test_without_filters_events_are_untouched() -> None:
    events = random_events(1)
    assert filtered(events) is events


@given(st.integers(0, 2**32), st.lists(st.integers(0, 3000), max_size=5))
@settings(deadline=None, max_examples=20)
def test_clean_stream_is_left_alone(seed: int, cuts: list[int]) -> None:
    size = (64, 48)
    events = together(poisson(0.3, size, 2.0, seed), edge(20, 48, 2.0))
    noise_filter = EventFilter(size, ClusteringConfig())
    for first, last in pairwise([0, *sorted(cuts), len(events)]):
        batch = events[first:last]
        assert noise_filter(batch) is batch
    assert noise_filter.left_out(np.inf) == (0, 0)
    assert noise_filter.noise(2.0, np.inf).passing == 0


@pytest.mark.parametrize("rows", [48, 4])
def test_little_noise_is_left_out_where_it_is_most_of_the_events(rows: int) -> None:
    """In the dark contours are as rare; the edge has 3.2 or 0.3 events per pixel and second."""
    size, rate = (64, 48), 0.6
    noise, contour = poisson(rate, size, 4.0), edge(20, rows, 4.0)
    kept = EventFilter(size, ClusteringConfig())(together(noise, contour)).between(2.0, 4.0)
    passes = (len(kept) - np.isin(kept.t, contour.t).sum()) / len(noise.between(2.0, 4.0))
    assert passes == 1 if rows == 48 else passes < 0.3


@pytest.mark.parametrize("size", [(96, 64), (240, 180), (346, 260)])
@pytest.mark.parametrize("rate", [1.0, 3.0, 8.0])
@pytest.mark.parametrize("moving", [False, True])
def test_noise_rate_is_found_beside_moving_contours(
    size: tuple[int, int], rate: float, moving: bool
) -> None:
    """The edge passes through half of the blocks."""
    noise = poisson(rate, size, 3.0)
    events = together(noise, edge(size[0] // 2, size[1], 3.0)) if moving else noise
    noise_filter = EventFilter(size, ClusteringConfig())
    kept = noise_filter(events)
    found = noise_filter.noise(3.0, np.inf)
    assert found.rate == pytest.approx(rate, rel=0.2)
    expected = 1 - (1 + EXPECTED) * np.exp(-EXPECTED)
    assert passing_share(rate, support_time(rate)) == pytest.approx(expected)
    assert found.passing == pytest.approx(expected * found.rate)
    if not moving:  # of noise alone, what passes is what was expected
        share = len(kept.between(1.0, 3.0)) / len(noise.between(1.0, 3.0))
        assert share == pytest.approx(expected, rel=0.2)
        assert sum(noise_filter.left_out(np.inf)) == len(noise) - len(kept)


@pytest.mark.parametrize("period", [0.005, 0.02, 0.05])
def test_slow_contours_stay_among_noise(period: float) -> None:
    """Each row of an edge goes from column to column in its own moment."""
    size, rows = (96, 64), np.arange(64)
    columns = np.arange(int(3.0 / period) - 1)
    when = np.random.default_rng(0).random(len(rows))
    t = period * (np.repeat(columns, len(rows)) + np.tile(when, len(columns)))
    x, y = np.repeat(columns % 96, len(rows)), np.tile(rows, len(columns))
    contour = Events(x.astype(np.uint16), y.astype(np.uint16), t, np.ones(len(t), bool))
    contour = contour[np.argsort(t, kind="stable")]
    noise = poisson(2.0, size, 3.0)
    kept = EventFilter(size, ClusteringConfig())(together(contour, noise)).between(1.0, 3.0)
    is_contour = np.isin(kept.t, contour.t)
    assert is_contour.sum() > 0.9 * len(contour.between(1.0, 3.0))
    assert (~is_contour).sum() < 0.3 * len(noise.between(1.0, 3.0))


def test_a_window_that_misses_events_does_not_change_the_noise_rate() -> None:
    size, rate = (96, 64), 3.0
    noise, noise_filter = poisson(rate, size, 4.0), EventFilter(size, ClusteringConfig())
    noise_filter(noise.between(0.0, 2.0))
    before = noise_filter.noise(2.0, np.inf).rate
    for start in np.arange(2.0, 4.0, 0.1):
        noise_filter.interrupt()
        noise_filter(noise.between(start, start + 0.02))
    assert noise_filter.noise(4.0, np.inf).rate == before == pytest.approx(rate, rel=0.2)


def test_contours_stay_while_noise_goes() -> None:
    size = (96, 64)
    noise, contour = poisson(5.0, size, 3.0), edge(96, 64, 3.0)
    kept = EventFilter(size, ClusteringConfig(hot_pixel_ratio=0))(together(noise, contour))
    late = kept.between(1.0, 3.0)
    of_contour = np.isin(late.t, contour.t).sum()
    assert of_contour > 0.95 * len(contour.between(1.0, 3.0))
    assert len(late) - of_contour < 0.4 * len(noise.between(1.0, 3.0))


def test_time_surface_grows_with_the_time_of_the_latest_event() -> None:
    surface = np.full((2, 3), -np.inf)
    surface[0] = 2.0, 2.05, 2.1
    image = of_surface(surface).time_surface(2.0, 2.1)
    np.testing.assert_array_equal(image, [[1, 128, 255], [0, 0, 0]])


@pytest.mark.parametrize("cut", [1, 7, 301])
def test_repeated_events_are_left_out(cut: int) -> None:
    """Every event twice gives what it gives once, in batches of any length."""
    once = random_events(3)
    twice = once[np.repeat(np.arange(len(once)), 2)]
    expected = EventFilter((WIDTH, HEIGHT), ClusteringConfig())(once)
    chosen = EventFilter((WIDTH, HEIGHT), ClusteringConfig())
    parts = [chosen(twice[k : k + cut]) for k in range(0, len(twice), cut)]
    found = Events.concatenate(parts)
    for name in ("x", "y", "t", "polarity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.fixture
def long_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MANY", 500)


@pytest.mark.parametrize("rate", [0.3, 0.6])
def test_one_of_several_windows_of_many_events_tells_the_same_noise(
    rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = (192, 128)
    events = together(poisson(rate, size, 4.0), edge(192, 128, 4.0))
    every, noise_filter = (EventFilter(size, ClusteringConfig()) for _ in range(2))
    assert len(every(events)) == len(events)
    monkeypatch.setattr(module, "MANY", 500)
    assert len(noise_filter(events)) == len(events)
    found, expected = (one.noise(4.0, np.inf).rate for one in (noise_filter, every))
    assert found == pytest.approx(expected, rel=0.1)
    begins = [noise.begin for noise in noise_filter._noise][1:]
    np.testing.assert_allclose(np.diff(begins), (UNSEEN + 1) * WINDOW, atol=0.01)


@pytest.mark.usefixtures("long_windows")
def test_all_windows_of_many_events_are_seen_while_there_is_noise() -> None:
    size = (96, 64)
    contour, noise = edge(96, 64, 4.0), poisson(5.0, size, 2.0)
    here, t = np.full(10_000, 16, np.uint16), np.linspace(0, 2, 10_000)
    hot = Events(here, here, t, np.ones(len(t), bool))
    for harm in (noise, hot):
        late = Events(harm.x, harm.y, harm.t + 2.0, harm.polarity)
        kept = EventFilter(size, ClusteringConfig())(together(contour, late))
        left = len(kept.between(3.5, 4.0)) - len(contour.between(3.5, 4.0))
        assert left < 0.4 * len(late.between(3.5, 4.0))


@pytest.mark.usefixtures("long_windows")
@given(cuts=st.lists(st.integers(0, 1500), max_size=6))
@settings(deadline=None, max_examples=20)
def test_batches_do_not_matter_where_windows_are_unseen(cuts: list[int]) -> None:
    size = (96, 64)
    events = together(poisson(0.5, size, 1.0), edge(96, 64, 1.0), edge(96, 64, 1.0))
    whole, parts = (EventFilter(size, ClusteringConfig()) for _ in range(2))
    kept = whole(events)
    ends = [0, *sorted(cuts), len(events)]
    joined = Events.concatenate([parts(events[a:b]) for a, b in pairwise(ends)])
    np.testing.assert_array_equal(joined.t, kept.t)
    assert list(whole._noise) == list(parts._noise)
