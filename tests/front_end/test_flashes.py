"""A flash is left out of the clusters; fast motion, and a light that stays on, are not."""

from __future__ import annotations

import numpy as np

from gpvo.config import ClusteringConfig
from gpvo.events import Clustering, StereoCluster
from gpvo.events.flashes import LONGEST, REMEMBERED, FlashDetector
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig

SIDE = 40
LENS = Camera((SIDE, SIDE), np.array([20.0, 20, 20, 20]), "none", np.zeros(4), np.eye(3))
RIG = StereoRig(LENS, LENS, 20.0, (20.0, 20.0), 0.1)
DURATION = 3.0
PLAIN = {"background_filter": 0.0, "hot_pixel_ratio": 0.0}


def edge(speed: float, duration: float = DURATION) -> Events:
    """Make the events of an upright edge, columns per second, that comes again and again.

    Every pixel has five events when it passes.
    """
    step = np.arange(int(duration * speed))
    t = np.arange(5 * SIDE * len(step)) / (5 * SIDE * speed)
    x, y = np.repeat(step % SIDE, 5 * SIDE), np.tile(np.arange(SIDE), 5 * len(step))
    return Events(x.astype(np.uint16), y.astype(np.uint16), t, np.ones(len(t), bool))


def all_pixels(start: float, duration: float, times: int) -> Events:
    """Make events of all pixels, each several times within a duration."""
    pixel = np.tile(np.arange(SIDE * SIDE), times)
    t = start + duration * np.arange(len(pixel)) / len(pixel)
    x, y = (pixel % SIDE).astype(np.uint16), (pixel // SIDE).astype(np.uint16)
    return Events(x, y, t, np.ones(len(t), bool))


def clusters(*parts: Events, skip: bool = True) -> list[StereoCluster]:
    events = Events.concatenate(parts)
    events = events[np.argsort(events.t, kind="stable")]
    batch = StereoEvents(0.0, DURATION, events, events)
    config = ClusteringConfig.model_validate({**PLAIN, "skip_flashes": skip})
    return list(Clustering(RIG, config).clusters([batch]))


def test_a_flash_is_left_out_and_its_time_is_said() -> None:
    found = clusters(edge(100.0), all_pixels(2.0, 0.02, 5))
    (flash,) = [cluster for cluster in found if cluster.flash > 0]
    assert 2.01 <= flash.start <= 2.1 and 0.01 <= flash.flash < 0.1
    kept = sum(cluster.left.event_count for cluster in found)
    with_it = clusters(edge(100.0), all_pixels(2.0, 0.02, 5), skip=False)
    assert all(cluster.flash == 0 for cluster in with_it)
    everything = sum(cluster.left.event_count for cluster in with_it)
    assert everything - kept > 0.9 * 5 * SIDE * SIDE


def test_fast_motion_is_kept() -> None:
    """Ten times as fast: as sudden as a flash, but clusters cover no more pixels than before."""
    fast = edge(1000.0, 0.5)
    later = Events(fast.x, fast.y, fast.t + 2.0, fast.polarity)
    slow = edge(100.0).between(0.0, 2.0)
    found = clusters(slow, later)
    assert all(cluster.flash == 0 for cluster in found)
    assert sum(c.left.event_count for c in found) == len(slow) + len(later)


def test_what_moves_after_a_rest_is_no_flash() -> None:
    """It covers many times the pixels of the noise, in a fraction of the clusters' time at rest."""
    detector = FlashDetector()
    assert not any(detector.is_flash(0.25, 0.025) for _ in range(REMEMBERED))
    assert not detector.is_flash(0.03, 0.5)
    assert detector.is_flash(0.002, 0.5)


def test_a_light_that_stays_is_the_new_normal() -> None:
    """No more than LONGEST is left out at a time."""
    detector = FlashDetector()
    assert not any(detector.is_flash(0.1, 0.1) for _ in range(REMEMBERED))
    left_out = [detector.is_flash(0.01, 1.0) for _ in range(100)]
    first = left_out.index(False)
    assert 0.01 * first <= LONGEST < 0.01 * (first + 2)
    assert not any(left_out[-30:])


def test_nothing_is_a_flash_before_it_is_known_what_is_usual() -> None:
    detector = FlashDetector()
    assert not any(detector.is_flash(0.1, 0.1) for _ in range(REMEMBERED - 1))
    assert not detector.is_flash(1e-3, 1.0)
