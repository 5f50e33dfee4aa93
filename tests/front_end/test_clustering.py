"""Clusters are a partition of the stereo stream, and keep the latest time of each pixel."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gpvo.config import ClusteringConfig
from gpvo.events import ClusterEvents, Clustering, ImageMotion, StereoCluster
from gpvo.events.clustering import LEAD, WIDEST
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig

HEIGHT, WIDTH = 12, 16
LENS = Camera((WIDTH, HEIGHT), np.array([20.0, 20, 8, 6]), "none", np.zeros(4), np.eye(3))
UNKNOWN = ImageMotion()
RIG = StereoRig(LENS, LENS, 20.0, (8.0, 6.0), 0.1)
seeds = st.integers(0, 2**32)


def random_events(rng: np.random.Generator, count: int, tick: float) -> Events:
    """Make events within a second, at multiples of a tick so that some times are equal."""
    t = np.sort(np.rint(rng.uniform(0, 1, count) / tick) * tick)
    t = t[t < 1]
    x, y = rng.integers(0, WIDTH, len(t)), rng.integers(0, HEIGHT, len(t))
    return Events(x.astype(np.uint16), y.astype(np.uint16), t, rng.random(len(t)) < 0.5)


def random_stream(seed: int) -> tuple[Events, Events]:
    rng = np.random.default_rng(seed)
    tick = rng.choice([1e-6, 1e-2])
    left, right = (random_events(rng, rng.integers(0, 400), tick) for _ in range(2))
    return left, right


def event_batches(left: Events, right: Events, cuts: list[float]) -> list[StereoEvents]:
    edges = [0.0, *sorted(cuts), 1.0]
    return [StereoEvents(a, b, left.between(a, b), right.between(a, b)) for a, b in pairwise(edges)]


def clusters(
    left: Events,
    right: Events,
    cuts: list[float],
    config: ClusteringConfig,
    motion: ImageMotion = UNKNOWN,
) -> list[StereoCluster]:
    batches = event_batches(left, right, cuts)
    return list(Clustering(RIG, config, lambda: motion).clusters(batches))


configs = st.builds(
    ClusteringConfig,
    window=st.sampled_from([0.02, 0.1, 0.3]),
    max_events=st.sampled_from([1, 7, 40, 10_000]),
    skip_flashes=st.just(False),
    background_filter=st.just(0.0),
    hot_pixel_ratio=st.just(0.0),
)
motions = st.sampled_from(
    [UNKNOWN, ImageMotion(10.0), ImageMotion(60.0, 500.0), ImageMotion(1000.0, 100.0)]
)
cut_lists = st.lists(st.floats(0, 1), max_size=30)


@given(seeds, cut_lists, configs)
@settings(deadline=None, max_examples=60)
def test_clusters_partition_the_stream(
    seed: int, cuts: list[float], config: ClusteringConfig
) -> None:
    left, right = random_stream(seed)
    found = clusters(left, right, cuts, config)
    assert found and found[0].start == 0.0
    assert all(a.stop == b.start and a.start < a.stop for a, b in pairwise(found))
    for cluster in found:
        for image, events in ((cluster.left, left), (cluster.right, right)):
            inside = (events.t >= cluster.start) & (events.t < cluster.stop)
            assert image.event_count == inside.sum()
            times = image.surface_of_active_events[np.isfinite(image.surface_of_active_events)]
            assert ((times >= cluster.start) & (times < cluster.stop)).all()


@given(seeds, cut_lists, configs)
@settings(deadline=None, max_examples=60)
def test_a_cluster_ends_by_time_or_by_the_count_of_either_camera(
    seed: int, cuts: list[float], config: ClusteringConfig
) -> None:
    left, right = random_stream(seed)
    for cluster in clusters(left, right, cuts, config):
        filled = []
        for events in (left, right):
            t = events.t[events.t >= cluster.start]
            if len(t) >= config.max_events:
                filled.append(t[config.max_events - 1])
        by_time = cluster.start + config.window
        first = min([*filled, 1.0])  # the stream's end
        by_count = first if first == 1.0 else np.nextafter(first, 2)
        assert cluster.stop == min(by_count, by_time)


@given(seeds, cut_lists, configs | st.just(ClusteringConfig()), motions)
@settings(deadline=None, max_examples=60)
def test_clusters_do_not_depend_on_the_batches(
    seed: int, cuts: list[float], config: ClusteringConfig, motion: ImageMotion
) -> None:
    """Nor do the noise filter's and the flash detector's judgement, however far ahead events go."""
    left, right = random_stream(seed)
    whole, parts = (clusters(left, right, c, config, motion) for c in ([], cuts))
    ahead = Clustering(RIG, config, lambda: motion)
    filtered = [ahead.without_noise(batch) for batch in event_batches(left, right, cuts)]
    found = [cluster for batch in filtered for cluster in ahead.add(batch)]
    found += ahead.end()
    for a, b in (*zip(whole, parts, strict=True), *zip(whole, found, strict=True)):
        assert (a.start, a.stop, a.flash) == (b.start, b.stop, b.flash)
        for x, y in ((a.left, b.left), (a.right, b.right)):
            np.testing.assert_array_equal(x.surface_of_active_events, y.surface_of_active_events)
            assert x.event_count == y.event_count
            assert x.contour_count == y.contour_count
            assert (x.noise_rate, x.left_out) == (y.noise_rate, y.left_out)


@given(seeds, st.floats(0.2, 0.7), st.floats(0.01, 0.2))
@settings(deadline=None, max_examples=30)
def test_time_without_data_is_in_no_cluster(seed: int, stop: float, missing: float) -> None:
    left, right = random_stream(seed)
    before, _, after = event_batches(left, right, [stop, stop + missing])
    clustering = Clustering(RIG, ClusteringConfig(window=0.1))
    found = list(clustering.clusters([before, after]))
    assert all(a.stop <= b.start for a, b in pairwise(found))
    assert all(cluster.stop <= stop or cluster.start >= stop + missing for cluster in found)
    assert any(cluster.start == stop + missing for cluster in found)


@given(seeds, cut_lists)
@settings(deadline=None, max_examples=30)
def test_every_event_is_in_a_cluster_or_left_out(seed: int, cuts: list[float]) -> None:
    left, right = random_stream(seed)
    config = ClusteringConfig(window=0.1, max_events=40, background_filter=0.02, skip_flashes=False)
    found = clusters(left, right, cuts, config)
    for name, events in (("left", left), ("right", right)):
        shown = [getattr(cluster, name) for cluster in found]
        kept = sum(image.event_count for image in shown)
        left_out = sum(sum(image.left_out) for image in shown)
        last = (events.t >= found[-1].stop).sum()  # less than half of a cluster is dropped
        places = np.stack([events.x, events.y, events.t], axis=1)
        repeated = len(events) - len(np.unique(places, axis=0))
        assert 0 <= len(events) - kept - left_out <= last + repeated


def test_a_batch_may_be_as_long_as_the_stream() -> None:
    """Noise is remembered until the cluster that it is in is taken."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 20, 8000))
    x, y = rng.integers(0, WIDTH, len(t)), rng.integers(0, HEIGHT, len(t))
    noise = Events(x.astype(np.uint16), y.astype(np.uint16), t, rng.random(len(t)) < 0.5)
    one = [StereoEvents(0.0, 20.0, noise, noise)]
    many = [
        StereoEvents(a, a + 0.5, noise.between(a, a + 0.5), noise.between(a, a + 0.5))
        for a in np.arange(0, 20, 0.5)
    ]
    config = ClusteringConfig(hot_pixel_ratio=0.0)
    rates, again = (
        [cluster.left.noise_rate for cluster in Clustering(RIG, config).clusters(batches)]
        for batches in (one, many)
    )
    assert rates[0] == 0 and rates == again
    assert np.mean(rates[20:]) == pytest.approx(8000 / 20 / (WIDTH * HEIGHT), rel=0.1)


@pytest.mark.parametrize(("window", "stops"), [(0.3, [0.3, 0.6, 0.9]), (0.65, [0.65, 1.0])])
def test_a_last_window_less_than_half_full_is_dropped(window: float, stops: list[float]) -> None:
    left, right = random_stream(0)
    found = clusters(left, right, [], ClusteringConfig(window=window, max_events=10_000))
    assert all(cluster.flash == 0 for cluster in found)
    assert [round(c.stop, 9) for c in found] == stops


@given(seeds, st.floats(1.0, 6.0), st.lists(st.floats(0, 1), max_size=6))
@settings(deadline=None, max_examples=40)
def test_clusters_are_apart_while_time_is_short(
    seed: int, spacing: float, cuts: list[float]
) -> None:
    """The events between are counted; the last one begins earlier if it would be short."""
    left, right = random_stream(seed)
    config = ClusteringConfig(window=0.05, background_filter=0.0, hot_pixel_ratio=0.0)
    clustering = Clustering(RIG, config, lambda: ImageMotion(1.0))
    clustering.hurry(spacing)
    batches = list(event_batches(left, right, cuts))
    found = list(clustering.clusters(batches))
    start, stop = np.array([(cluster.start, cluster.stop) for cluster in found]).T
    begin = (start + min(spacing, WIDEST) * (stop - start))[:-1]
    if len(begin) and stop[-1] == batches[-1].stop:
        earliest = stop[-2] if spacing == 1 else max(stop[-2], begin[-1] - LEAD)
        begin[-1] = max(earliest, min(begin[-1], stop[-1] - config.window))
    np.testing.assert_allclose(start[1:], begin, atol=1e-9)
    for before, cluster in zip([None, *found], found, strict=False):
        begin = 0.0 if before is None else before.stop
        between = (side.between(begin, cluster.start) for side in (left, right))
        assert cluster.between == sum(map(len, between))
        for side, events in ((cluster.left, left), (cluster.right, right)):
            expected = events.between(cluster.start, cluster.stop)
            np.testing.assert_array_equal(side.events.t, expected.t)


def test_clusters_are_not_apart_where_the_motion_is_unknown() -> None:
    """From 0.3 to 0.48 s, say."""
    left, right = random_stream(1)
    known: list[ImageMotion] = [ImageMotion(1.0)]
    clustering, starts = Clustering(RIG, ClusteringConfig(window=0.05), lambda: known[0]), []
    clustering.hurry(3.0)
    for cluster in clustering.clusters(event_batches(left, right, [])):
        starts.append(cluster.start)
        known[0] = UNKNOWN if 0.29 < cluster.start < 0.48 else ImageMotion(1.0)
    expected = [0.0, 0.15, 0.3, 0.35, 0.4, 0.45, 0.5, 0.65, 0.8, 0.95]
    np.testing.assert_allclose(starts, expected, atol=1e-9)


def random_table(rng: np.random.Generator) -> NDArray[np.float32]:
    """Make a rectification that moves events by up to three pixels and loses a few."""
    table = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).astype(np.float32)
    table += rng.uniform(-3, 3, table.shape).astype(np.float32)
    table[rng.random((HEIGHT, WIDTH)) < 0.05] = np.nan
    table[rng.random((HEIGHT, WIDTH)) < 0.05] = 1e30
    return table


@given(seeds)
@settings(deadline=None, max_examples=40)
def test_surface_holds_the_latest_time_of_each_rectified_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    events, table = random_events(rng, 300, 1e-6), random_table(rng)
    column, row = np.rint(table[events.y, events.x]).T
    inside = (column >= 0) & (column < WIDTH) & (row >= 0) & (row < HEIGHT)
    expected = np.full((HEIGHT, WIDTH), -np.inf)
    pixel = row[inside].astype(int), column[inside].astype(int)
    np.maximum.at(expected, pixel, events.t[inside])

    image = ClusterEvents((events,), table, (WIDTH, HEIGHT))
    np.testing.assert_array_equal(image.surface_of_active_events, expected)
    assert image.event_count == len(events)
    raw_pixels = set(zip(events.x.tolist(), events.y.tolist(), strict=True))
    assert image.coverage == pytest.approx(len(raw_pixels) / (WIDTH * HEIGHT))
    white = np.zeros((HEIGHT, WIDTH), np.uint8)
    white[pixel] = 255
    np.testing.assert_array_equal(image.binary_frame, white)
    assert image.binary_frame.dtype == np.uint8


def test_polarity_is_ignored() -> None:
    rng = np.random.default_rng(0)
    events, table = random_events(rng, 300, 1e-6), random_table(rng)
    opposite = Events(events.x, events.y, events.t, ~events.polarity)
    a, b = (ClusterEvents((e,), table, (WIDTH, HEIGHT)) for e in (events, opposite))
    np.testing.assert_array_equal(a.surface_of_active_events, b.surface_of_active_events)
