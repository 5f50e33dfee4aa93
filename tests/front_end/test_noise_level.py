"""A camera at rest sends noise from all of its sensor; one that fails sends little, of contours."""

from __future__ import annotations

import numpy as np
import pytest

from gpvo.config import ClusteringConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.events.cluster_length import ClusterLength, ImageMotion
from gpvo.events.flashes import FlashDetector
from gpvo.events.noise_level import NoiseLevel
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
def test_noise_of_any_rate_is_that_of_a_camera_at_rest(rate: float) -> None:
    level, rng = NoiseLevel(), np.random.default_rng(0)
    judged = [level.is_noise(noise(rate, rng)) for _ in range(20)]
    assert all(judged[4:])


def test_a_stream_begins_with_noise_only_if_it_is_even() -> None:
    level, rng = NoiseLevel(), np.random.default_rng(0)
    assert level.may_be_noise(cluster(np.zeros(SHAPE, bool))) is None
    assert level.may_be_noise(noise(1.0, rng)) is True
    level.clear()
    mixed = cluster(noise(1.0, rng).left.active | contours(0.9, rng).left.active)
    assert level.may_be_noise(mixed) is False


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5])
def test_what_is_left_of_contours_is_not(share: float) -> None:
    level, rng = NoiseLevel(), np.random.default_rng(0)
    assert not any(level.is_noise(contours(share, rng)) for _ in range(20))


def test_one_camera_alone_is_not_enough() -> None:
    level, rng = NoiseLevel(), np.random.default_rng(0)
    alive, dead = noise(1.0, rng), cluster(np.zeros(SHAPE, bool))
    assert not level.is_noise(StereoCluster(0.0, 0.1, alive.left, dead.right))


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
    level, rng = NoiseLevel(), np.random.default_rng(0)
    y, x = (index.astype(np.uint16) for index in np.nonzero(rng.random((240, 320)) < 0.1))
    events = Events(x, y, np.full(len(x), 0.05), np.ones(len(x), bool))
    larger = ClusterEvents((events,), np.zeros((240, 320, 2), np.float32), (320, 240))
    assert level.is_noise(StereoCluster(0.0, 0.1, larger, noise(1.0, rng).right))
    assert not level.is_noise(StereoCluster(0.0, 0.1, larger, contours(0.5, rng).right))
