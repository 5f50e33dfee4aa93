"""A camera is at rest where contours have no events, however many are noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpvo.events import ClusterEvents, StereoCluster
from gpvo.recordings import Events
from gpvo.tracking.rest import Rest

SHAPE = (180, 240)
Mask = np.ndarray


def cluster(seen: Mask, noise_count: float = 0.0) -> StereoCluster:
    """Make a cluster with an event at each pixel of a mask, in both cameras."""
    y, x = (index.astype(np.uint16) for index in np.nonzero(seen))
    events = Events(x, y, np.full(len(x), 0.05), np.ones(len(x), bool))
    table = np.zeros((*SHAPE, 2), np.float32)
    side = ClusterEvents((events,), table, SHAPE[::-1], noise_count=noise_count)
    return StereoCluster(0.0, 0.1, side, side)


def noise(per_pixel: float, rng: np.random.Generator) -> Mask:
    return rng.random(SHAPE) < per_pixel


def contours(share: float, rng: np.random.Generator) -> Mask:
    """Make a share of the events of ten upright bars, which are in a part of the sensor."""
    seen = np.zeros(SHAPE, bool)
    for column in range(20, 220, 20):
        seen[20:150, column : column + 12] = True
    return seen & (rng.random(SHAPE) < share)


def moved(noise_per_pixel: float, rng: np.random.Generator) -> Rest:
    """See the camera move among noise."""
    rest = Rest()
    for _ in range(5):
        rest.see(cluster(contours(0.8, rng) | noise(noise_per_pixel, rng)))
        assert not rest.at_rest and not rest.is_still
    return rest


@pytest.mark.parametrize("per_pixel", [0.02, 0.08, 0.25, 0.5])
@pytest.mark.parametrize("before", [0.0, 0.1])
def test_noise_of_any_length_is_rest(per_pixel: float, before: float) -> None:
    """Here one of one event per pixel and second."""
    rng = np.random.default_rng(0)
    rest = moved(before, rng)
    for _ in range(20):
        rest.see(replace(cluster(noise(per_pixel, rng)), stop=per_pixel))
        assert rest.at_rest and rest.is_still


@pytest.mark.parametrize("share", [0.15, 0.3, 0.8])
@pytest.mark.parametrize("per_pixel", [0.0, 0.08, 0.25])
def test_slow_motion_among_noise_is_none(share: float, per_pixel: float) -> None:
    rng = np.random.default_rng(1)
    rest = moved(0.02, rng)
    for _ in range(10):
        rest.see(cluster(contours(share, rng) | noise(per_pixel, rng)))
        assert not rest.at_rest and not rest.is_still


def test_noise_that_passes_the_filter_in_pairs_is_rest() -> None:
    rng = np.random.default_rng(2)
    rest = moved(0.02, rng)
    for _ in range(10):
        first = noise(0.006, rng)
        pairs = first | np.roll(first, 1, axis=0)
        rest.see(cluster(pairs, float(pairs.sum())))
        assert rest.at_rest


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_without_noise_the_cameras_may_have_failed(share: float) -> None:
    rng = np.random.default_rng(3)
    rest = moved(0.02, rng)
    for _ in range(10):
        rest.see(cluster(contours(share, rng)))
        assert rest.is_still and not rest.at_rest


def test_what_is_left_of_a_flash_is_no_rest() -> None:
    """It is as even as noise, but sudden."""
    rng = np.random.default_rng(6)
    rest = moved(0.02, rng)
    flash = replace(cluster(noise(0.1, rng)), stop=0.001)
    rest.see(flash)
    assert not rest.at_rest
    rest.see(replace(flash, stop=0.1))
    assert rest.at_rest


def test_one_camera_alone_is_not_enough() -> None:
    rng = np.random.default_rng(4)
    rest = moved(0.02, rng)
    alive, dead = cluster(noise(0.02, rng)), cluster(np.zeros(SHAPE, bool))
    rest.see(StereoCluster(0.0, 0.1, alive.left, dead.right))
    assert rest.is_still and not rest.at_rest


def test_a_stream_begins_at_rest_only_if_its_events_are_even() -> None:
    rng = np.random.default_rng(5)
    rest = Rest()
    rest.see(cluster(np.zeros(SHAPE, bool)))
    assert rest.is_still and not rest.at_rest, "nothing is known of few events"
    rest.see(cluster(noise(0.1, rng)))
    assert rest.at_rest
    rest.see(cluster(noise(0.1, rng) | contours(0.8, rng)))
    assert not rest.at_rest


def test_an_image_smaller_than_a_block_is_never_at_rest() -> None:
    small = ClusterEvents((), np.zeros((8, 8, 2), np.float32), (8, 8))
    rest = Rest()
    for _ in range(3):
        rest.see(replace(cluster(np.zeros(SHAPE, bool)), left=small, right=small))
        assert not rest.at_rest
