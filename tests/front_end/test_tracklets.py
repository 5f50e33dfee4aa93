"""Feature times compared with brute force, filters at their thresholds, and the tracklet store."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shown_events import of_surface

from gpvo.config import TrackletConfig
from gpvo.events import StereoCluster
from gpvo.mc_ransac import segments_between
from gpvo.tracking import Measurements, Observations, Tracklets
from gpvo.tracking.tracklets import BREAK, LEAST_LANDMARKS, feature_times

HEIGHT, WIDTH = 60, 80
seeds = st.integers(0, 2**32)
# (landmark, u, v, disparity, t_left, t_right) of one sighting
Sighting = tuple[int, float, float, float, float, float]


def random_surface(rng: np.random.Generator, events: int) -> NDArray[np.float64]:
    surface = np.full((HEIGHT, WIDTH), -np.inf)
    pixels = rng.choice(surface.size, events, replace=False)
    surface.flat[pixels] = rng.random(events)
    return surface


def distances(surface: NDArray[np.float64], point: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Compute the distances from a point to all events, and return the events' times too."""
    row, column = np.nonzero(np.isfinite(surface))
    return np.hypot(column - point[0], row - point[1]), surface[row, column]


@given(seeds, st.sampled_from([1, 2, 30, 1500]))
@settings(deadline=None, max_examples=60)
def test_time_is_that_of_the_nearest_event(seed: int, events: int) -> None:
    rng = np.random.default_rng(seed)
    surface = random_surface(rng, events)
    points = rng.uniform([-0.5, -0.5], [WIDTH + 0.5, HEIGHT + 0.5], (20, 2))
    for point, time in zip(points, feature_times(surface, points, 0.0), strict=True):
        distance, times = distances(surface, point)
        assert time == times[distance.argmin()]


@given(seeds, st.sampled_from([1, 30, 1500]), st.sampled_from([0.5, 1.0, 5.0, 7.3]))
@settings(deadline=None, max_examples=60)
def test_time_is_the_mean_within_the_radius(seed: int, events: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    surface = random_surface(rng, events)
    points = rng.uniform([-0.5, -0.5], [WIDTH + 0.5, HEIGHT + 0.5], (20, 2))
    points[:10] = np.rint(points[:10])  # the circle's edge runs through pixels
    for point, time in zip(points, feature_times(surface, points, radius), strict=True):
        distance, times = distances(surface, point)
        near = distance <= radius
        if near.any():
            np.testing.assert_allclose(time, times[near].mean(), rtol=1e-12)
        else:
            assert time in times[np.isclose(distance, distance.min())]


def test_an_empty_surface_has_no_times() -> None:
    surface = np.full((HEIGHT, WIDTH), -np.inf)
    assert np.isnan(feature_times(surface, np.array([[3.0, 4.0]]), 5.0)).all()


# Every threshold is a binary fraction, so that "at the threshold" is exact.
CONFIG = TrackletConfig(
    time_radius=0,
    max_stereo_time_difference=1 / 64,
    min_disparity=2.0,
    min_length=5.0,
    min_duration=1 / 16,
    history=4,
)
EARLIER_FRAMES = 3


def add(tracklets: Tracklets, frame: int, *sightings: Sighting, late: float = 0.0) -> None:
    """Add a cluster that shows each landmark's events at the given times, or so much later."""
    left, right = (np.full((HEIGHT, WIDTH), -np.inf) for _ in range(2))
    for _, u, v, disparity, t_left, t_right in sightings:
        left[int(v), int(u)] = t_left + late
        right[int(v), int(u - disparity)] = t_right + late
    columns = np.array(sightings, np.float64).reshape(-1, 6)
    points = columns[:, 1:3]
    tracklets.add(
        StereoCluster(
            frame / 8 + late, (frame + 1) / 8 + late, of_surface(left), of_surface(right)
        ),
        Observations(
            columns[:, 0].astype(np.int64),
            np.full(len(columns), frame),
            points,
            points - np.column_stack([columns[:, 3], np.zeros(len(columns))]),
        ),
    )


def two_sightings(
    stereo_time: float = 0.0,
    disparity: float = 8.0,
    motion: tuple[float, float] = (6.0, 0.0),
    duration: float = 1 / 8,
) -> tuple[Measurements, int]:
    """Return the measurements of a landmark seen twice, and the number of its segments."""
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    add(tracklets, 0, (3, 30, 20, disparity, 1.0, 1.0 + stereo_time))
    t = 1.0 + duration
    add(tracklets, 1, (3, 30 + motion[0], 20 + motion[1], disparity, t, t + stereo_time))
    earlier, later = tracklets.pairs(span=1)
    assert len(earlier) == len(later)
    return tracklets.take(np.array([3])), len(later)


@pytest.mark.parametrize(
    ("sightings", "passes"),
    [
        ({"stereo_time": 1 / 64}, True),
        ({"stereo_time": -1 / 64}, True),
        ({"stereo_time": 1 / 64 + 1e-9}, False),
        ({"stereo_time": -1 / 64 - 1e-9}, False),
        ({"disparity": 2.0}, True),
        ({"disparity": 2.0 - 1e-9}, False),
        ({"motion": (3.0, 4.0)}, True),
        ({"motion": (-3.0, -4.0)}, True),
        ({"motion": (3.0, 4.0 - 1e-9)}, False),
        ({"duration": 1 / 16}, True),
        ({"duration": 1 / 16 - 1e-9}, False),
        ({"duration": -1 / 8}, True),
    ],
)
def test_filters_at_their_thresholds(sightings: dict, passes: bool) -> None:
    measurements, segments = two_sightings(**sightings)
    assert len(measurements) == (2 if passes else 0)
    in_order = sightings.get("duration", 1) > 0
    assert segments == (1 if passes and in_order else 0)


def test_measurements_are_stereo_pixels_at_the_left_event() -> None:
    measurements, _ = two_sightings(stereo_time=1 / 128)
    np.testing.assert_array_equal(measurements.t, [1.0, 1.125])
    np.testing.assert_array_equal(measurements.stereo, [[30, 20, 8], [36, 20, 8]])
    np.testing.assert_array_equal(measurements.landmark, [3, 3])
    np.testing.assert_array_equal(measurements.frame, [0, 1])


def moving(landmark: int, frame: int, speed: float = 4.0) -> Sighting:
    """Return the sighting of a landmark on a row of its own, shortly after the time frame / 8."""
    t = frame / 8 + landmark / 1024
    return landmark, 20 + speed * frame, 5.0 * landmark + 5, 8.0, t, t


ALL = np.arange(10)


def test_take_gives_every_measurement_once() -> None:
    tracklets, given = Tracklets(CONFIG, EARLIER_FRAMES), []
    for frame in range(6):
        add(tracklets, frame, *(moving(landmark, frame) for landmark in range(3)))
        given.append(tracklets.take(ALL))
    assert [len(g) for g in given] == [0, 0, 9, 3, 3, 3]
    everything = Measurements.concatenate(given)
    pairs = np.column_stack([everything.landmark, everything.frame])
    assert len(np.unique(pairs, axis=0)) == 18
    assert len(tracklets.take(ALL)) == 0


def test_take_gives_only_the_landmarks_asked_for() -> None:
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    for frame in range(3):
        add(tracklets, frame, *(moving(landmark, frame) for landmark in range(3)))
    assert set(tracklets.take(np.array([0, 2])).landmark) == {0, 2}
    assert set(tracklets.take(ALL).landmark) == {1}


def test_reject_forgets_the_newest_measurements_alone() -> None:
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    for frame in range(3):
        add(tracklets, frame, *(moving(landmark, frame) for landmark in range(2)))
    tracklets.reject(np.array([0]))
    assert tracklets.pairs(span=4)[1].landmark.tolist() == [1]
    add(tracklets, 3, moving(0, 3))
    taken = tracklets.take(ALL)
    assert taken.frame[taken.landmark == 0].tolist() == [0, 1, 3]
    assert taken.frame[taken.landmark == 1].tolist() == [0, 1, 2]


@pytest.mark.parametrize("span", [1, 2, 3])
def test_segments_end_in_the_newest_cluster_and_stay_within_the_span(span: int) -> None:
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    for frame in range(4):
        seen = [moving(0, frame), moving(1, frame)]
        if frame != 3:
            seen.append(moving(2, frame))  # lost in the newest
        if frame == 0:
            seen.append(moving(3, frame))  # not seen for long
        add(tracklets, frame, *seen)
    earlier, later = tracklets.pairs(span)
    assert later.landmark.tolist() == [0, 1]
    segments = segments_between(earlier, later)
    np.testing.assert_array_equal(segments.dt, [span / 8] * 2)
    np.testing.assert_array_equal(segments.later[:, 0], [20 + 4 * 3] * 2)
    np.testing.assert_array_equal(segments.earlier[:, 0], [20 + 4 * (3 - span)] * 2)


def test_no_segment_bridges_a_break() -> None:
    """The velocity is not constant for so long; what was not given before it is not given later."""
    tracklets, late = Tracklets(CONFIG, EARLIER_FRAMES), BREAK + 0.125
    for frame in (0, 1):
        add(tracklets, frame, moving(0, frame), moving(1, frame))
    add(tracklets, 2, moving(0, 2), moving(1, 2), late=late)
    assert len(tracklets.pairs(3)[1]) == 0
    add(tracklets, 3, moving(0, 3), moving(1, 3), late=late)
    earlier, later = tracklets.pairs(3)
    np.testing.assert_array_equal(segments_between(earlier, later).dt, [1 / 8] * 2)
    assert sorted(set(tracklets.take(ALL).frame.tolist())) == [2, 3]


def test_clusters_that_show_nothing_are_no_part_of_span_and_history() -> None:
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    for frame in range(12):
        add(tracklets, frame, *([moving(0, frame)] if frame in (0, 1, 10, 11) else []))
        if 1 < frame < 10:
            assert len(tracklets.pairs(span=2)[0]) == 0
    earlier, later = tracklets.pairs(span=2)
    assert (earlier.frame.tolist(), later.frame.tolist()) == ([1], [11])
    assert tracklets.take(ALL).frame.tolist() == [0, 1, 10, 11]


@given(seeds)
@settings(deadline=None, max_examples=30)
def test_any_segment_has_a_positive_time_and_two_measurements(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracklets, span = Tracklets(CONFIG, EARLIER_FRAMES), int(rng.integers(1, 5))
    for frame in range(6):
        seen = rng.permutation(10)[: rng.integers(0, 10)]
        times = frame / 8 + rng.uniform(-0.2, 0.2, len(seen))
        add(
            tracklets,
            frame,
            *(
                (int(k), rng.uniform(12, 70), 5.0 * k + 5, 8.0, t, t)
                for k, t in zip(seen, times, strict=True)
            ),
        )
        earlier, later = tracklets.pairs(span)
        landmarks = later.landmark
        assert (later.t > earlier.t).all() and len(np.unique(landmarks)) == len(landmarks)
        newest = dict(zip(seen.tolist(), times, strict=True))
        assert set(landmarks.tolist()) <= set(newest)
        tracklets.reject(rng.permutation(10)[:2])
        tracklets.take(landmarks)


def test_history_is_limited() -> None:
    """Slow landmarks need older clusters to be long enough, and these must not be too old."""
    for frames, expected in ((3, 0), (4, 4), (5, 4), (9, 4)):
        tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
        for frame in range(frames):
            add(tracklets, frame, moving(0, frame, speed=2.0))
        assert len(tracklets.take(ALL)) == expected


def test_observations_of_earlier_clusters_are_timed_there() -> None:
    """The viso2 tracker extends tracklets backwards."""
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    first, second = moving(0, 0), moving(0, 2)
    left = np.full((HEIGHT, WIDTH), -np.inf)
    for frame, (_, u, v, _, t, _) in ((0, first), (2, second)):
        left[:] = -np.inf
        left[int(v), int(u)] = t
        cluster = StereoCluster(frame / 8, frame / 8 + 1 / 8, *[of_surface(left)] * 2)
        points = np.array([[s[1], s[2]] for s in (first, second)])
        seen = Observations(np.zeros(2, int), np.array([0, 1]), points, points - [8.0, 0])
        nothing = Observations(seen.landmark[:0], seen.frame[:0], points[:0], points[:0])
        tracklets.add(cluster, seen if frame == 2 else nothing)
    taken = tracklets.take(ALL)
    assert taken.frame.tolist() == [0, 1]
    np.testing.assert_array_equal(taken.t, [first[4], second[4]])


def test_times_of_the_tracker_take_the_place_of_the_surface() -> None:
    tracklets, surface = Tracklets(CONFIG, EARLIER_FRAMES), np.full((HEIGHT, WIDTH), 5 / 64)
    own = np.array([[1 / 64, 2 / 64], [np.nan, np.nan], [4 / 64, np.nan], [1 / 64, 3 / 64]])
    left = np.column_stack([[20.0] * 4, 10 * np.arange(4) + 5])
    for frame in range(2):
        points = left + np.array([8.0 * frame, 0])
        right = points - np.array([8.0, 0])
        seen = Observations(np.arange(4), np.full(4, frame), points, right, own + frame / 8)
        tracklets.add(StereoCluster(0.0, 1 / 8, *[of_surface(surface)] * 2), seen)
        surface += 1 / 8
    taken = tracklets.take(ALL)
    assert taken.landmark.tolist() == [0, 0, 1, 1, 2, 2]  # 3 fails the stereo filter
    np.testing.assert_array_equal(taken.t[::2], np.array([1, 5, 4]) / 64)
    np.testing.assert_array_equal(taken.t[1::2], np.array([1, 5, 4]) / 64 + 1 / 8)


def test_observations_without_events_are_dropped() -> None:
    tracklets, nothing = Tracklets(CONFIG, EARLIER_FRAMES), np.full((HEIGHT, WIDTH), -np.inf)
    point = np.array([[20.0, 20.0]])
    for frame in range(3):
        tracklets.add(
            StereoCluster(frame / 8, (frame + 1) / 8, *[of_surface(nothing)] * 2),
            Observations(
                np.array([0]), np.array([frame]), point + 5 * frame, point + 5 * frame - [8, 0]
            ),
        )
        assert len(tracklets.pairs(4)[0]) == len(tracklets.take(ALL)) == 0


@pytest.mark.parametrize("min_length", [0.0, 1e-9])
def test_a_landmark_at_rest_passes_unless_a_length_is_asked_for(min_length: float) -> None:
    """It does not move, and lasts 1 / 8 s from its second sight on."""
    tracklets = Tracklets(CONFIG.model_copy(update={"min_length": min_length}), EARLIER_FRAMES)
    for frame in range(2):
        add(tracklets, frame, moving(0, frame, speed=0.0))
    assert len(tracklets.pairs(span=4)[1]) == (min_length == 0)
    assert len(tracklets.take(ALL)) == 2 * (min_length == 0)
    assert tracklets.too_short() == (min_length > 0)


def test_counts_of_what_the_filters_left_out_are_those_of_the_newest_cluster() -> None:
    tracklets = Tracklets(CONFIG, EARLIER_FRAMES)
    late = (7, 40.0, 55.0, 8.0, 0.1, 0.2)  # left and right are 100 ms apart
    near, far = moving(0, 0), (3, 60.0, 30.0, 1.0, 0.1, 0.1)  # a disparity of 1 pixel
    add(tracklets, 0, near, moving(1, 0, speed=0.5), late, far)
    assert (tracklets.out_of_bounds, tracklets.too_short()) == (2, 0)
    # 0 and 1 moved by 4 and 0.5 pixels, 2 is new.
    add(tracklets, 1, moving(0, 1), moving(1, 1, speed=0.5), moving(2, 1))
    assert (tracklets.out_of_bounds, tracklets.too_short()) == (0, 2)
    add(tracklets, 2, moving(0, 2), moving(1, 2, speed=0.5), moving(2, 2))
    assert tracklets.too_short() == 2  # 0 has moved by 8 pixels, 2 by 4
    assert tracklets.pairs(span=4)[1].landmark.tolist() == [0]


@given(seeds, st.floats(0, 400), st.floats(-np.pi, np.pi))
@settings(deadline=None, max_examples=30)
def test_image_speed_is_that_of_landmarks_that_move_alike(
    seed: int, speed: float, direction: float
) -> None:
    """Each is seen at times of its own."""
    rng = np.random.default_rng(seed)
    velocity = speed * np.array([np.cos(direction), np.sin(direction)])
    places = rng.uniform([20, 20], [60, 60], (LEAST_LANDMARKS, 2))
    known = Tracklets(CONFIG, EARLIER_FRAMES)
    for frame in range(2):
        t = frame / 8 + rng.uniform(0, 1 / 8 - 1e-3, LEAST_LANDMARKS) + frame * 1e-3
        add_timed(known, frame, places + t[:, None] * velocity, t)
        assert (known.image_speed() is None) == (frame == 0)
    assert known.image_speed() == pytest.approx(speed, abs=1e-6)


def test_image_speed_is_that_of_the_slower_landmarks_between_the_two_newest_clusters() -> None:
    """Near landmarks rush by; a lower quartile does not see them."""
    known, speeds = Tracklets(CONFIG, EARLIER_FRAMES), np.array([*[16.0] * 4, *[160.0] * 8])
    places = np.column_stack([np.full(12, 20.0), np.linspace(5, 75, 12)])
    for frame in range(4):
        # In the first cluster all are where fast ones would have come from.
        left = places + [100.0 * (frame == 0), 0] + frame / 8 * speeds[:, None] * [1, 0]
        add_timed(known, frame, left, np.full(12, frame / 8))
    assert known.image_speed() == pytest.approx(16.0)
    add_timed(known, 4, places[: LEAST_LANDMARKS - 1], np.full(LEAST_LANDMARKS - 1, 0.5))
    assert known.image_speed() is None


def add_timed(tracklets: Tracklets, frame: int, left: NDArray, t: NDArray) -> None:
    """Add a cluster with landmarks at left pixels (N, 2) and times (N,) that are known."""
    empty = of_surface(np.full((HEIGHT, WIDTH), -np.inf))
    tracklets.add(
        StereoCluster(frame / 8, (frame + 1) / 8, empty, empty),
        Observations(
            np.arange(len(t)),
            np.full(len(t), frame),
            left,
            left - [8.0, 0],
            np.column_stack([t, t]),
        ),
    )
