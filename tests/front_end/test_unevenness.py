"""Noise is even over the sensor, contours are not; what is usual is what was seen in motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpvo.config import ClusteringConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.events.cluster_length import ClusterLength, ImageMotion
from gpvo.events.flashes import FlashDetector
from gpvo.events.unevenness import Unevenness, squared_variation
from gpvo.recordings import Camera, Events, StereoRig

SHAPE = (180, 240)


def cluster(seen: np.ndarray) -> StereoCluster:
    """Make a cluster with an event at each pixel of a mask, in both cameras."""
    y, x = (index.astype(np.uint16) for index in np.nonzero(seen))
    events = Events(x, y, np.full(len(x), 0.05), np.ones(len(x), bool))
    side = ClusterEvents((events,), np.zeros((*SHAPE, 2), np.float32), SHAPE[::-1])
    return StereoCluster(0.0, 0.1, side, side)


def noise(rate: float, rng: np.random.Generator) -> StereoCluster:
    return cluster(rng.random(SHAPE) < 0.1 * rate)


def contours(share: float, rng: np.random.Generator) -> StereoCluster:
    """Make a share of the events of three upright bars."""
    seen = np.zeros(SHAPE, bool)
    for column in (50, 110, 180):
        seen[:, column : column + 12] = True
    return cluster(seen & (rng.random(SHAPE) < share))


@pytest.mark.parametrize("rate", [0.05, 0.2, 5.0])
def test_noise_of_any_rate_is_even(rate: float) -> None:
    unevenness, rng = Unevenness(), np.random.default_rng(0)
    found = [unevenness.squared_variation(noise(rate, rng)) for _ in range(20)]
    assert max(abs(known) for known in found[4:] if known is not None) < 0.15
    assert None not in found[4:]


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_what_is_left_of_contours_is_as_uneven_as_all_of_them(share: float) -> None:
    unevenness, rng = Unevenness(), np.random.default_rng(0)
    whole = Unevenness().squared_variation(contours(1.0, rng))
    for _ in range(4):
        found = unevenness.squared_variation(contours(share, rng))
    assert found == pytest.approx(whole, rel=0.2)


def test_of_too_few_events_nothing_is_known() -> None:
    unevenness, rng = Unevenness(), np.random.default_rng(0)
    assert unevenness.squared_variation(cluster(np.zeros(SHAPE, bool))) is None
    assert unevenness.squared_variation(noise(1.0, rng)) is not None
    unevenness.clear()
    assert unevenness.squared_variation(noise(0.01, rng)) is None


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.0))
def test_noise_does_not_change_the_spread(seed: int, rate: float) -> None:
    """n^2 (var n - mean n) / (mean n)^2 of contours alone is that among any even noise."""
    rng = np.random.default_rng(seed)
    rates = 20 * rng.gamma(1.0, 1.0, 2000)
    alone, among = rng.poisson(rates), rng.poisson(rates + 20 * rate)
    spread = [
        counts.mean() * np.sqrt(squared_variation(counts, counts.mean()))
        for counts in (alone, among)
    ]
    assert spread[1] == pytest.approx(spread[0], rel=0.15)


def test_noise_that_passes_a_filter_in_pairs_is_even() -> None:
    rng = np.random.default_rng(0)
    pairs = 2 * rng.poisson(3.0, 5000)
    assert squared_variation(pairs, pairs.mean()) > 0.1
    assert squared_variation(pairs, 2 * pairs.mean()) == pytest.approx(0, abs=0.01)


def test_motion_after_rest_is_no_flash() -> None:
    """What is usual is what was seen in motion."""
    detector = FlashDetector()
    for _ in range(20):
        assert not detector.is_flash(0.02, 0.2)
    assert not any(detector.is_flash(0.1, 0.005) for _ in range(40))
    assert not any(detector.is_flash(0.015, 0.2) for _ in range(20))


def test_motion_after_rest_has_clusters_as_before() -> None:
    camera = Camera((240, 180), np.array([200.0, 200, 8, 6]), "none", np.zeros(4), np.eye(3))
    length = ClusterLength(ClusteringConfig(), StereoRig(camera, camera, 200.0, (8.0, 6.0), 0.1))
    for events in [20_000] * 10 + [300] * 40:
        length.add(events, events, 0.1)
    assert length.limits(ImageMotion(50.0))[1] == 40_000


def test_the_cameras_may_have_other_sizes() -> None:
    unevenness, rng = Unevenness(), np.random.default_rng(0)
    y, x = (index.astype(np.uint16) for index in np.nonzero(rng.random((240, 320)) < 0.1))
    events = Events(x, y, np.full(len(x), 0.05), np.ones(len(x), bool))
    larger = ClusterEvents((events,), np.zeros((240, 320, 2), np.float32), (320, 240))
    even = unevenness.squared_variation(StereoCluster(0.0, 0.1, larger, noise(1.0, rng).right))
    assert even == pytest.approx(0, abs=0.05)
    uneven = unevenness.squared_variation(StereoCluster(0.0, 0.1, larger, contours(0.5, rng).right))
    assert uneven is not None and uneven > 0.5
