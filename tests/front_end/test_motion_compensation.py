"""Motion-compensated pictures: sharp with the right image motion, harmless with a wrong one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.config.stages import CompensationConfig
from gpvo.events import ClusterEvents, RectifiedEvents, StereoCluster
from gpvo.tracking import Observations
from gpvo.tracking.motion_compensation import (
    CompensatedImage,
    Flow,
    MotionCompensation,
    flow_between,
)

SHAPE = (60, 80)
START, STOP = 0.40, 0.46
MIDDLE = 0.43
seeds = st.integers(0, 2**32)
motions = st.tuples(st.floats(-120, 120), st.floats(-120, 120)).map(np.array)


def constant_flow(motion: np.ndarray) -> Flow:
    return np.broadcast_to(motion, (*SHAPE, 2)).astype(np.float32)


def spot(place: np.ndarray, motion: np.ndarray, seed: int, count: int = 400) -> RectifiedEvents:
    """Simulate events around a moving point that is at `place` in the middle of the cluster.

    `motion` is in pixels per second.
    """
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(START, STOP, count) ** 2 / STOP)
    t = np.clip(t, START, STOP)
    shape = rng.normal(0, 1.0, (count, 2)).clip(-2, 2)
    points = place + shape - shape.mean(axis=0) + (t - MIDDLE)[:, None] * motion
    return RectifiedEvents(points, t, np.ones(count, bool))


def centroid(image: CompensatedImage) -> np.ndarray:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.array([(image.count * u).sum(), (image.count * v).sum()]) / image.count.sum()


@given(seeds, motions, motions)
@settings(deadline=None, max_examples=30)
def test_a_wrong_image_motion_cancels_at_the_events_own_time(
    seed: int, true: np.ndarray, assumed: np.ndarray
) -> None:
    place = np.array([40.0, 30.0])
    events = spot(place, true, seed)
    image = CompensatedImage.of_events(events, constant_flow(assumed), MIDDLE)
    (found,), (time,) = image.at_own_times(centroid(image)[None], radius=25.0)
    np.testing.assert_allclose(time, events.t.mean(), atol=1e-9)
    np.testing.assert_allclose(found, events.points.mean(axis=0), atol=1e-4)
    assert image.count.sum() == pytest.approx(len(events))


@given(seeds, motions)
@settings(deadline=None, max_examples=30)
def test_the_right_image_motion_makes_pictures_as_sharp_as_a_still_camera(
    seed: int, motion: np.ndarray
) -> None:
    place = np.array([40.0, 30.0])
    moving, still = spot(place, motion, seed), spot(place, np.zeros(2), seed)
    image = CompensatedImage.of_events(moving, constant_flow(motion), MIDDLE)
    expected = CompensatedImage.of_events(still, constant_flow(np.zeros(2)), MIDDLE)
    np.testing.assert_allclose(image.count, expected.count, atol=1e-3)
    np.testing.assert_array_less(np.abs(image.picture.astype(int) - expected.picture), 2)


@given(seeds, motions)
@settings(deadline=None, max_examples=30)
def test_equal_motion_of_all_features_is_that_of_all_pixels(seed: int, motion: np.ndarray) -> None:
    points = np.random.default_rng(seed).uniform(0, SHAPE[::-1], (20, 2))
    flow = flow_between(points, points + 0.02 * motion, 0.02, SHAPE, reach=10.0)
    np.testing.assert_allclose(flow, constant_flow(motion), atol=1e-3)


def test_image_motion_is_that_of_the_features_near() -> None:
    left = np.column_stack([np.full(10, 10.0), np.linspace(5, 55, 10)])
    right = left + np.array([60.0, 0.0])
    step = np.array([1.0, 0.0])
    earlier, later = np.vstack([left, right]), np.vstack([left + step, right - step])
    flow = flow_between(earlier, later, 0.01, SHAPE, reach=8.0)
    np.testing.assert_allclose(flow[15:45, 8:12, 0], 100, atol=2)
    np.testing.assert_allclose(flow[15:45, 68:72, 0], -100, atol=2)


def test_observations_get_times_and_places_of_their_own_events() -> None:
    """Features and events move alike, so the observations are at their true positions."""
    motion, disparity = np.array([80.0, -30.0]), np.array([6.0, 0.0])
    places = np.random.default_rng(3).uniform([15, 12], [65, 48], (12, 2))
    compensation = MotionCompensation(CompensationConfig(time_radius=4.0), frames=3)
    for number in range(3):
        start = 0.06 * number

        def image(offset: np.ndarray, start: float = start) -> ClusterEvents:
            t = np.repeat(start + np.array([0.01, 0.02, 0.03]), len(places))
            points = np.tile(places + offset, (3, 1)) + t[:, None] * motion
            events = RectifiedEvents(points, t, np.ones(len(t), bool))
            return ClusterEvents(np.full(SHAPE, -np.inf), len(t), lambda: events)

        cluster = StereoCluster(start, start + 0.06, image(np.zeros(2)), image(-disparity))
        left, _ = compensation.pictures(cluster)
        # The first two pictures are blurred around the mean time of their events.
        blurred = start + 0.02 if number < 2 else start + 0.03
        seen = places + blurred * motion
        found = compensation.timed(
            Observations(np.arange(12), np.full(12, number), seen, seen - disparity)
        )
        np.testing.assert_allclose(found.times, start + 0.02, atol=1e-3)
        expected = places + found.times[:, :1] * motion
        np.testing.assert_allclose(found.left, expected, atol=0.12)
        np.testing.assert_allclose(found.left - found.right, [disparity] * 12, atol=1e-9)
    assert left.max() > 200  # three events of a point in one place
