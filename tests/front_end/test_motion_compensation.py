"""Motion-compensated pictures: sharp with the right image motion, harmless with a wrong one."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shown_events import of_surface, shown

from gpvo.config.stages import CompensationConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.tracking import Observations
from gpvo.tracking.compensated_image import CompensatedImage
from gpvo.tracking.event_sums import CELL, Flow, brightness, motion_at
from gpvo.tracking.feature_flow import direction, flow_between
from gpvo.tracking.motion_compensation import MotionCompensation
from gpvo.tracking.tracker import to_full_resolution

SHAPE = (60, 80)
START, STOP = 0.40, 0.46
MIDDLE = 0.43
seeds = st.integers(0, 2**32)
motions = st.tuples(st.floats(-120, 120), st.floats(-120, 120)).map(np.array)


def constant_flow(motion: np.ndarray) -> Flow:
    return np.full((1, 1, 2), motion, np.float32)


def spot(place: np.ndarray, motion: np.ndarray, seed: int, count: int = 400) -> ClusterEvents:
    """Simulate events around a moving point that is at `place` in the middle of the cluster.

    `motion` is in pixels per second.
    """
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(START, STOP, count) ** 2 / STOP)
    t = np.clip(t, START, STOP)
    shape = rng.normal(0, 1.0, (count, 2)).clip(-2, 2)
    points = place + shape - shape.mean(axis=0) + (t - MIDDLE)[:, None] * motion
    return shown(points, t, SHAPE)


def difference(picture: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(picture.astype(float) - other).mean())


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
    np.testing.assert_allclose(time, events.events.t.mean(), atol=1e-9)
    np.testing.assert_allclose(found, events.table[0].mean(axis=0), atol=1e-4)
    assert image.count.sum() == pytest.approx(events.event_count)


@given(seeds, st.floats(0.1, 8.0))
@settings(deadline=None, max_examples=30)
def test_pictures_are_as_bright_as_the_formula_to_half_a_grey_level(
    seed: int, weight: float
) -> None:
    sums = np.random.default_rng(seed).exponential(2.0, (20, 30, 2)).astype(np.float32)
    sums[0] = 0, 1e6
    sums[1] = 1e6, 0
    formula = 255 * (1 - np.exp(-weight * sums[..., 0].astype(float)))
    found = brightness(sums, weight)
    np.testing.assert_allclose(found, formula, atol=0.502)
    assert (found[0] == 0).all() and (found[1] == 255).all()


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


@given(seeds, st.sampled_from([0.5, 1.0, 1.9, 2.0, 7.3]))
@settings(deadline=None, max_examples=30)
def test_of_dense_events_one_of_several_is_drawn_as_bright(seed: int, times: float) -> None:
    """Sums are those of the events that are drawn; at least as many as are enough.

    Events that come in parts are the same.
    """
    count = 4000
    events = spot(np.array([40.0, 30.0]), np.array([80.0, -30.0]), seed, count)
    density = count / times / (SHAPE[0] * SHAPE[1])
    every = max(1, int(times))
    given = events, constant_flow(np.zeros(2)), MIDDLE, 1
    image, everything = (CompensatedImage.of_events(*given, each) for each in (density, None))
    drawn = replace(events, parts=(events.events[np.arange(0, count, every)],))
    alone = CompensatedImage.of_events(drawn, *given[1:])
    np.testing.assert_array_equal(image.sums, alone.sums)
    cuts = np.sort(np.random.default_rng(seed).integers(0, count, 3))
    ends = [0, *cuts.tolist(), count]
    parts = tuple(events.events[first:last] for first, last in pairwise(ends))
    in_parts = CompensatedImage.of_events(replace(events, parts=parts), *given[1:], density)
    np.testing.assert_array_equal(in_parts.sums, image.sums)
    assert in_parts.thinned == image.thinned
    assert image.thinned == count - drawn.event_count and everything.thinned == 0
    assert drawn.event_count >= count / times or every == 1
    means = [float(one.picture.mean()) for one in (image, everything)]
    assert means[0] == pytest.approx(means[1], rel=0.15)


@given(seeds, motions)
@settings(deadline=None, max_examples=30)
def test_equal_motion_of_all_features_is_that_of_all_pixels(seed: int, motion: np.ndarray) -> None:
    points = np.random.default_rng(seed).uniform(0, SHAPE[::-1], (20, 2))
    flow = flow_between(points, points + 0.02 * motion, 0.02, SHAPE, reach=10.0)
    anywhere = points + np.array([3.0, -40.0])
    np.testing.assert_allclose(motion_at(flow, anywhere), np.tile(motion, (20, 1)), atol=1e-3)


def pixels(first: int, last: int) -> np.ndarray:
    """Return the pixels (N, 2) of some columns in the middle of the image."""
    v, u = np.mgrid[15:45, first:last]
    return np.column_stack([u.ravel(), v.ravel()]).astype(float)


def test_image_motion_is_that_of_the_features_near() -> None:
    left = np.column_stack([np.full(10, 10.0), np.linspace(5, 55, 10)])
    right = left + np.array([60.0, 0.0])
    step = np.array([1.0, 0.0])
    earlier, later = np.vstack([left, right]), np.vstack([left + step, right - step])
    flow = flow_between(earlier, later, 0.01, SHAPE, reach=8.0)
    np.testing.assert_allclose(motion_at(flow, pixels(8, 12))[:, 0], 100, atol=2)
    np.testing.assert_allclose(motion_at(flow, pixels(68, 72))[:, 0], -100, atol=2)


@given(motions.filter(lambda motion: np.hypot(*motion) > 1e-3))
def test_the_direction_is_that_of_most_cells_whatever_their_speed(motion: np.ndarray) -> None:
    flow = np.tile(motion, (3, 3, 1)).astype(np.float32)
    flow[0, 0] = 500.0
    np.testing.assert_allclose(direction(flow), np.abs(motion) / np.hypot(*motion), atol=1e-6)
    np.testing.assert_array_equal(direction(0 * flow), 1.0)  # any


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_image_motion_is_bilinear_between_the_middles_of_cells(seed: int) -> None:
    flow = np.random.default_rng(seed).normal(0, 100, (5, 7, 2)).astype(np.float32)
    large = cv2.resize(flow, (7 * CELL, 5 * CELL))
    v, u = np.mgrid[: 5 * CELL, : 7 * CELL]
    found = motion_at(flow, np.column_stack([u.ravel(), v.ravel()]).astype(float))
    np.testing.assert_allclose(found, large.reshape(-1, 2), atol=1e-3)


def cluster_at(start: float, events: ClusterEvents, noise_count: float = 0.0) -> StereoCluster:
    noisy = replace(events, noise_count=noise_count)
    return StereoCluster(start, start + 0.06, noisy, noisy)


def scattered(start: float, count: int, columns: int = SHAPE[1]) -> ClusterEvents:
    """Make events at random pixels of the whole sensor, or of its first columns."""
    rng = np.random.default_rng(count)
    surface = np.full(SHAPE, -np.inf)
    pixels = rng.permutation(surface.size)
    pixels = pixels[pixels % SHAPE[1] < columns][:count]
    surface.ravel()[pixels] = rng.uniform(start, start + 0.06, len(pixels))
    return of_surface(surface)


def contours(start: float, count: int) -> ClusterEvents:
    """Make events of contours, which are in the left half of the sensor."""
    return scattered(start, count, SHAPE[1] // 2)


@pytest.mark.parametrize(("events", "noise_count"), [(120, 0.0), (500, 490.0)])
def test_at_rest_pictures_are_held_and_times_go_on(events: int, noise_count: float) -> None:
    """Few events from all over, or hardly more than the sensor's noise: nothing moved."""
    compensation = MotionCompensation(CompensationConfig(time_radius=4.0), frames=5)
    places = np.random.default_rng(3).uniform([15, 12], [65, 48], (12, 2))
    pictures, observed = [], []
    for number in range(5):
        start, still = 0.06 * number, number >= 3
        seen = scattered(start, events) if still else contours(start, 2000)
        pictures.append(
            compensation.pictures(cluster_at(start, seen, noise_count if still else 0.0))
        )
        assert compensation.at_rest == still
        found = Observations(np.arange(12), np.full(12, number), places, places - [5.0, 0])
        observed.append(compensation.timed(found))
    for held in pictures[3:]:
        np.testing.assert_array_equal(held, pictures[2])
    for number, found in enumerate(observed[3:], 3):
        # The features are where they were in the picture, and at the cluster's middle.
        np.testing.assert_array_equal(found.left, places)
        np.testing.assert_allclose(found.times, 0.06 * number + 0.03, rtol=1e-12)


def test_motion_after_rest_has_pictures_of_its_own_events() -> None:
    compensation = MotionCompensation(CompensationConfig(), frames=5)
    for number, count in enumerate([1000, 1000, 10, 900]):
        left, _ = compensation.pictures(cluster_at(0.06 * number, contours(0.06 * number, count)))
    assert not compensation.at_rest
    fresh = MotionCompensation(CompensationConfig(), frames=5)
    expected, _ = fresh.pictures(cluster_at(0.18, contours(0.18, 900)))
    np.testing.assert_array_equal(left, expected)


@pytest.mark.parametrize("count", [200, 600, 2500])
def test_a_stream_that_begins_at_rest_shows_nothing_until_something_moves(count: int) -> None:
    """Noise of both cameras is no motion, whatever its rate."""
    compensation = MotionCompensation(CompensationConfig(), frames=5)
    for number in range(8):
        seen = cluster_at(0.06 * number, scattered(0.06 * number, count + number))
        left, right = compensation.pictures(seen)
        assert compensation.at_rest and not (left.any() or right.any())
    for number in range(8, 10):
        left, _ = compensation.pictures(cluster_at(0.06 * number, contours(0.06 * number, 1500)))
        assert left.any() and not compensation.at_rest


@pytest.mark.parametrize("sharpest", [True, False])
def test_where_features_are_lost_pictures_are_sharp_even_so(sharpest: bool) -> None:
    """The motion turned meanwhile: that of the features before blurs more than none."""
    config = CompensationConfig(time_radius=4.0, little_motion=0.0, sharpest=sharpest)
    compensation = MotionCompensation(config, frames=5)
    places = np.random.default_rng(5).uniform([15, 12], [65, 48], (12, 2))

    def cluster(number: int, motion: np.ndarray) -> StereoCluster:
        rng, start = np.random.default_rng(number), 0.06 * number
        t = np.sort(rng.uniform(start, start + 0.06, 3000))
        points = places[rng.integers(12, size=3000)] + rng.normal(0, 0.5, (3000, 2))
        points += (t - start - 0.03)[:, None] * motion
        return cluster_at(start, shown(points, t, SHAPE))

    ahead = np.array([150.0, 0.0])
    for number in range(3):
        compensation.pictures(cluster(number, ahead))
        seen = places + 0.06 * number * ahead if number < 2 else places[:0]
        landmark, frame = np.arange(len(seen)), np.full(len(seen), number)
        compensation.timed(Observations(landmark, frame, seen, seen))
    back = cluster(3, -ahead)
    left, _ = compensation.pictures(back)
    true, blurred = (
        CompensatedImage.of_events(back.left, constant_flow(motion), back.middle).picture
        for motion in (-ahead, ahead)
    )
    if sharpest:
        assert difference(left, true) < 0.2 * difference(blurred, true)
    else:
        np.testing.assert_array_equal(left, blurred)


def test_half_resolution_pictures_are_those_of_events_in_larger_pixels() -> None:
    """They are as bright where each of the four pixels of the sensor has as many events."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 0.06, 3000))
    points = rng.integers(8, 300, (3000, 2)) / 4.0  # exact at both resolutions
    small = shown(points, t, SHAPE)
    four = np.repeat(to_full_resolution(points, 2), 4, axis=0), np.repeat(t, 4)
    large = shown(*four, (2 * SHAPE[0], 2 * SHAPE[1]))
    full = MotionCompensation(CompensationConfig(density=None), frames=2)
    half = MotionCompensation(CompensationConfig(density=None), frames=2, side=2)
    pictures = half.pictures(StereoCluster(0.0, 0.06, large, large))
    np.testing.assert_array_equal(pictures, full.pictures(cluster_at(0.0, small)))


def test_observations_get_times_and_places_of_their_own_events() -> None:
    """Features and events move alike, so the observations are at their true positions."""
    motion, disparity = np.array([80.0, -30.0]), np.array([6.0, 0.0])
    places = np.random.default_rng(3).uniform([15, 12], [65, 48], (12, 2))
    compensation = MotionCompensation(CompensationConfig(time_radius=4.0, lag_share=0.0), frames=3)
    for number in range(3):
        start = 0.06 * number

        def image(offset: np.ndarray, start: float = start) -> ClusterEvents:
            t = np.repeat(start + np.array([0.01, 0.02, 0.03]), len(places))
            points = np.tile(places + offset, (3, 1)) + t[:, None] * motion
            return shown(points, t, SHAPE)

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
