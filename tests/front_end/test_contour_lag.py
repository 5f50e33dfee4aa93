"""Contours are seen behind where they are, by half of the way between two events of a pixel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from shown_events import shown

from gpvo.config.stages import CompensationConfig, TrackletConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.recordings import Events
from gpvo.tracking import Observations
from gpvo.tracking.contour_lag import ContourLag
from gpvo.tracking.event_spacing import FEWEST
from gpvo.tracking.event_sums import Flow
from gpvo.tracking.motion_compensation import TURN, UNSURE, MotionCompensation
from gpvo.tracking.tracklets import Tracklets

WAVELENGTH, AMPLITUDE = 10.0, 0.6
LANDMARKS = 12
WAY = 2.0
"""Way of the landmarks in a cluster, pixels."""
SPACING = 0.5
"""Way between two events of the pixels that have two, pixels."""


def flow(u: float, v: float) -> Flow:
    return np.full((1, 1, 2), (u, v), np.float32)


def events_of_a_pixel(places: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    """Return the places of a wave, as they pass a pixel, at which it has an event."""
    seen, events = AMPLITUDE * np.sin(2 * np.pi * places / WAVELENGTH), []
    last = float(seen[0])
    for place, value in zip(places.tolist(), seen.tolist(), strict=True):
        while abs(value - last) >= threshold:
            last += math.copysign(threshold, value - last)
            events.append(place)
    return np.array(events)


@pytest.mark.parametrize("threshold", [0.05, 0.1, 0.2, 0.3])
def test_the_events_of_a_slope_come_late_by_half_a_threshold(threshold: float) -> None:
    """They are where the brightness is C / 2 farther than in the middle of the slope."""
    late = []
    for start in np.linspace(0, 1, 40):  # all phases of the last event before
        places = np.arange(start, start + 10 * WAVELENGTH, 0.002)
        events = events_of_a_pixel(places, threshold)[20:]
        # Slopes are half a wavelength long, with their middles at its multiples.
        late.append((events + WAVELENGTH / 4) % (WAVELENGTH / 2) - WAVELENGTH / 4)
    brightness = AMPLITUDE * np.sin(2 * np.pi * np.concatenate(late) / WAVELENGTH)
    assert brightness.mean() == pytest.approx(threshold / 2, rel=0.15)


@given(st.floats(0.02, 0.3), st.floats(0.05, 0.5))
def test_that_is_half_of_the_way_between_two_events(threshold: float, gradient: float) -> None:
    """On a slope up and down: behind the events' mean place by half of their distance."""
    period = 2.0 / gradient  # brightness from 0 to 1 and back
    late, apart = [], []
    for start in np.linspace(0, threshold / gradient, 20, endpoint=False):  # all phases, once
        places = np.arange(start, start + 4 * period, 0.002 * period)
        values = np.abs((gradient * places + 1) % 2 - 1)
        last, events = float(values[0]), []
        for place, value in zip(places.tolist(), values.tolist(), strict=True):
            if abs(value - last) >= threshold:
                last += math.copysign(threshold, value - last)
                events.append(place)
        late += [(place % (period / 2)) - period / 4 for place in events[len(events) // 2 :]]
        apart.append(float(np.median(np.diff(events))))
    assert np.mean(late) == pytest.approx(np.mean(apart) / 2, abs=0.03 / gradient)


def ahead(lag: ContourLag) -> NDArray[np.float64]:
    (found,) = lag.ahead(np.zeros((1, 2)))
    return found


def test_the_lag_turns_with_the_way_and_not_with_the_time() -> None:
    lag = ContourLag(0.5)
    for _ in range(6):  # a pixel each
        lag.follow(flow(50.0, 0.0), 1 / 50, 1 / 50, 0.6)
    np.testing.assert_allclose(ahead(lag), [0.3, 0.0], atol=1e-5)
    lag.follow(flow(-0.1, 0.0), 1.0, 1.0, 0.6)  # a tenth of a pixel: it does not turn round at once
    assert 0.1 < ahead(lag)[0] < 0.3
    lag.follow(flow(0.0, 0.0), 100.0, 100.0, 0.6)
    assert 0.1 < ahead(lag)[0] < 0.3
    for _ in range(6):
        lag.follow(flow(0.0, -10.0), 0.1, 0.1, 0.6)
    np.testing.assert_allclose(ahead(lag), [0.0, -0.3], atol=1e-5)


@given(st.floats(0.1, 3.0), st.floats(0, 2 * np.pi), st.floats(5.0, 400.0))
def test_the_lag_follows_the_way_of_a_cluster(spacing: float, angle: float, speed: float) -> None:
    """It is a share of the spacing, and four times the way has twice the lag, at any speed."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    for way in (1.0, 4.0):
        lag = ContourLag(0.5)
        for _ in range(40):
            lag.follow(flow(*(speed * direction)), way / speed, way / speed, spacing)
        expected = 0.5 * spacing * np.sqrt(way) * direction
        np.testing.assert_allclose(ahead(lag), expected, rtol=1e-4, atol=1e-5)


def test_time_between_clusters_turns_the_lag_and_does_not_add_to_it() -> None:
    spaced, usual = ContourLag(0.5), ContourLag(0.5)
    for _ in range(6):
        spaced.follow(flow(50 * WAY, 0.0), 4 / 50, 1 / 50, 0.6)
        usual.follow(flow(50 * WAY, 0.0), 1 / 50, 1 / 50, 0.6)
    np.testing.assert_allclose(ahead(spaced), ahead(usual), atol=1e-3)
    spaced.follow(flow(-0.1, 0.0), 8.0, 0.02, 0.6)  # turned round, and gone on for longer than seen
    usual.follow(flow(-0.1, 0.0), 0.02, 0.02, 0.6)
    assert ahead(spaced)[0] < 0.3 * ahead(usual)[0]


@given(st.lists(st.tuples(st.floats(-80, 80), st.floats(-80, 80)), min_size=2, max_size=5))
def test_it_is_known_how_far_the_lag_turned(motions: list[tuple[float, float]]) -> None:
    lag, before = ContourLag(0.5), np.zeros(2)
    for motion in motions:
        (turn,) = lag.follow(flow(*motion), 1 / 50, 1 / 50, 0.6).reshape(-1, 2)
        np.testing.assert_allclose(turn, ahead(lag) - before, atol=1e-6)
        before = ahead(lag)


def test_without_motion_nothing_is_known_of_the_lag() -> None:
    np.testing.assert_array_equal(ContourLag(0.5).ahead(np.ones((3, 2))), np.zeros((3, 2)))


def repeated(events: ClusterEvents, middle: float, speed: float) -> ClusterEvents:
    """Add pixels that have two events, between which contours of that speed move by SPACING."""
    places = np.random.default_rng(4).uniform([15, 12], [65, 48], (2 * FEWEST, 2))
    table = np.concatenate([events.table, places[None].astype(np.float32)], axis=1)
    x = np.tile(np.arange(events.table.shape[1], table.shape[1], dtype=np.uint16), 2)
    t = middle + np.repeat([-0.5, 0.5], len(places)) * SPACING / speed
    more = Events(x, np.zeros(len(x), np.uint16), t, np.ones(len(x), bool))
    return replace(events, parts=(*events.parts, more), table=table)


def observed(
    lag: float, left_motion: NDArray[np.float64], right_motion: NDArray[np.float64]
) -> list[Observations]:
    """Observe LANDMARKS that move so (pixels per second) in three clusters, by WAY in each."""
    count, step = LANDMARKS, WAY / np.linalg.norm(left_motion)
    places = np.random.default_rng(3).uniform([15, 12], [65, 48], (count, 2))
    compensation, parts = MotionCompensation(CompensationConfig(lag_share=lag), frames=3), []
    for number in range(3):
        t = step * (number + np.repeat([0.4, 0.5, 0.6], count))
        left, right = (
            shown(np.tile(places + shift, (3, 1)) + t[:, None] * motion, t, (60, 80))
            for shift, motion in (([0.0, 0.0], left_motion), ([-5.0, 0.0], right_motion))
        )
        left = repeated(left, step * (number + 0.5), float(np.linalg.norm(left_motion)))
        compensation.pictures(StereoCluster(step * number, step * (number + 1), left, right))
        middle, numbers = step * (number + 0.5), (np.arange(count), np.full(count, number))
        seen = places + middle * left_motion, places - [5.0, 0.0] + middle * right_motion
        parts.append(compensation.timed(Observations(*numbers, *seen)))
    # The first wait for the second cluster, which tells the motion, if it must be known.
    assert [len(part) for part in parts] == [count * n for n in ((1, 1, 1), (0, 2, 1))[lag > 0]]
    return parts


def test_observations_are_moved_ahead_by_the_lag() -> None:
    motion = np.array([40.0, 30.0])
    without, with_lag = (
        Observations.concatenate(observed(lag, motion, motion)) for lag in (0.0, 0.5)
    )
    np.testing.assert_array_equal(with_lag.landmark, without.landmark)
    np.testing.assert_array_equal(with_lag.frame, without.frame)
    way = with_lag.left - without.left
    expected = np.tile(0.25 * motion / np.linalg.norm(motion), (len(way), 1))
    np.testing.assert_allclose(way, expected, atol=5e-3)  # nearly turned in the second cluster
    np.testing.assert_allclose(way[-LANDMARKS:], expected[-LANDMARKS:], atol=1e-3)
    np.testing.assert_allclose(with_lag.right - without.right, way, atol=1e-9)
    np.testing.assert_allclose(with_lag.times, without.times, atol=1e-4)


def test_the_disparity_of_what_comes_nearer_has_the_lag_of_both_images() -> None:
    """Left of the image's middle and right of it, contours lag in opposite directions."""
    motions = np.array([30.0, 0.0]), np.array([-30.0, 0.0])
    without, with_lag = (observed(lag, *motions)[-1] for lag in (0.0, 0.5))
    np.testing.assert_allclose(with_lag.left - without.left, [[0.25, 0.0]] * LANDMARKS, atol=1e-3)
    np.testing.assert_allclose(with_lag.disparity - without.disparity, 2 * 0.25, atol=1e-3)
    np.testing.assert_array_equal(with_lag.right[:, 1], with_lag.left[:, 1])


def test_observations_count_less_while_the_lag_turns() -> None:
    """After a turn they hardly count until the motion is known again, then less at first."""
    count, step, speed = 20, 0.05, 60.0
    places = np.random.default_rng(5).uniform([25, 12], [55, 48], (count, 2))
    ways = speed * step * np.array([0, 1, 2, 3, 2, 1, 0])
    firsts, doubts = [0, 0, 0, 0, 100, 100, 100], list[float]()
    compensation = MotionCompensation(CompensationConfig(lag_share=0.3), frames=3)
    for number, (way, first) in enumerate(zip(ways, firsts, strict=True)):
        now = places + np.array([way, 0.0])
        t = step * (number + np.repeat([0.4, 0.5, 0.6], count))
        events = shown(np.tile(now, (3, 1)), t, (60, 80))
        events = repeated(events, step * (number + 0.5), speed)
        compensation.pictures(StereoCluster(step * number, step * (number + 1), events, events))
        numbers = first + np.arange(count), np.full(count, number)
        given = np.full((count, 3), 0.5)
        seen = Observations(*numbers, now, now - [5.0, 0.0], own_deviations=given)
        seen = compensation.timed(seen)
        assert len(seen) == [0, 2 * count, *[count] * 5][number]
        np.testing.assert_array_equal(seen.deviations[:, 2], 0.5)
        np.testing.assert_array_equal(seen.deviations[:, 0], seen.deviations[:, 1])
        doubts += (seen.deviations[::count, 0] / 0.5).tolist()
    lag = np.linalg.norm(np.median(compensation._lag.left.ahead(places), axis=0))
    assert doubts[:2] == [1.0, pytest.approx(np.hypot(1, lag / TURN), rel=0.02)]  # it was unknown
    assert doubts[4:6] == [UNSURE, pytest.approx(np.hypot(1, 2 * lag / TURN), rel=0.02)]
    np.testing.assert_allclose([doubts[3], doubts[6]], 1.0, atol=0.02)  # it stays


def test_tracklets_begin_with_observations_that_waited() -> None:
    """Observations of the cluster before belong to the history like those of the newest."""
    nothing = np.empty((0, 2))
    tracklets = Tracklets(TrackletConfig(min_length=1.0, history=2), earlier_frames=1)
    events = shown(nothing, np.empty(0), (60, 80))
    place, step, one = np.array([[40.0, 30.0]]), np.array([[2.0, 0.0]]), np.array([0])

    def seen(number: int) -> Observations:
        left, times = place + number * step, np.full((1, 2), 0.05 * number)
        return Observations(one, one + number, left, left - [5.0, 0.0], times)

    parts = [seen(0)[:0], Observations.concatenate([seen(0), seen(1)]), seen(2)]
    for number, observations in enumerate(parts):
        cluster = StereoCluster(0.05 * number, 0.05 * (number + 1), events, events)
        tracklets.add(cluster, observations)
        earlier, later = tracklets.pairs(span=4)
        assert later.frame.tolist() == ([] if number == 0 else [number])
        assert earlier.frame.tolist() == [[], [0], [1]][number]  # two clusters are remembered
