"""Where contours have few events they hardly moved: the pictures go on showing them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shown_events import shown

from gpvo import Configuration, Odometry
from gpvo.config.stages import CompensationConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.tracking import Observations
from gpvo.tracking.contour_way import COMMON, FEW, ContourWay
from gpvo.tracking.event_sums import brightness
from gpvo.tracking.missing_data import MissingData
from gpvo.tracking.motion_compensation import MotionCompensation

PERIOD, LITTLE = 0.05, 1.5
SHAPE = (60, 80)
densities = st.floats(10, 1e5)
"""Events of contours for each pixel of their way."""


def moved(speeds: list[float], density: float, little: float = LITTLE) -> ContourWay:
    """Let contours move at the mean speeds of consecutive clusters, pixels per second."""
    way = ContourWay(little)
    for speed in speeds:
        way.see(density * speed * PERIOD, PERIOD, PERIOD)
        way.learn(speed)
    return way


@given(st.floats(50, 1000), st.floats(0.01, 0.9), densities)
def test_the_way_is_that_of_the_mean_speed_of_both_clusters(
    usual: float, slower: float, density: float
) -> None:
    slow = slower * FEW * usual
    way = moved([usual, usual, usual, slow], density)
    assert way.share == pytest.approx(slow / usual)
    assert way.value == pytest.approx((usual + slow) / 2 * PERIOD)
    assert way.is_little == (way.value < LITTLE)


@given(st.floats(FEW + 1e-6, 10), densities)
def test_more_events_are_more_than_a_little_motion(faster: float, density: float) -> None:
    way = moved([10.0, 10.0, faster * 10.0], density, inf)
    assert way.value == inf and not way.is_little


def test_the_way_is_unknown_before_any_motion_is() -> None:
    way = ContourWay(LITTLE)
    for count in (1000.0, 1000.0, 1.0):
        way.see(count, PERIOD, PERIOD)
        assert way.value == inf and not way.is_little


@given(st.lists(st.floats(0.1, 2.0), min_size=1, max_size=8), densities)
def test_ways_add_up_until_a_picture_is_made_of_new_events(
    speeds: list[float], density: float
) -> None:
    way, before, since = moved([20.0], density), 20.0, 0.0
    for speed in speeds:
        way.see(density * speed * PERIOD, PERIOD, PERIOD)
        since = (before + speed) / 2 * PERIOD + (since if since < LITTLE else 0.0)
        assert way.value == pytest.approx(since)
        before = speed


@given(st.floats(0, 100), st.floats(0, 100))
def test_what_moved_farther_is_less_certain(a: float, b: float) -> None:
    doubts = []
    for value in sorted([a, b]):
        way = ContourWay(inf)
        way.value = value
        doubts.append(way.doubt(np.array([1.0, 0.5, 0.0])))
    assert (doubts[0] <= doubts[1]).all()
    assert all(whole >= half >= none == 1 for whole, half, none in doubts)


def contours(number: int, count: int) -> ClusterEvents:
    """Make a cluster's events near twelve corners, which stay where they are."""
    rng = np.random.default_rng(number)
    corners = np.random.default_rng(0).uniform([15, 12], [65, 48], (12, 2))
    points = corners[rng.integers(0, 12, count)] + rng.normal(0, 1, (count, 2)).clip(-2, 2)
    return shown(points, np.sort(PERIOD * (number + rng.random(count))), SHAPE)


def run(counts: list[int], little: float = LITTLE) -> tuple[MotionCompensation, list[Observations]]:
    """Track twelve features, which move by a pixel in a cluster of many events."""
    config = CompensationConfig(little_motion=little, lag_share=0.0, density=None)
    compensation, found = MotionCompensation(config, frames=5), []
    places = np.random.default_rng(0).uniform([15, 12], [65, 48], (12, 2))
    for number, count in enumerate(counts):
        start, events = PERIOD * number, contours(number, count)
        compensation.pictures(StereoCluster(start, start + PERIOD, events, events))
        places = places + np.array([count / max(counts), 0.0])
        seen = Observations(np.arange(12), np.full(12, number), places, places - [5.0, 0.0])
        found.append(compensation.timed(seen))
    return compensation, found


def test_pictures_of_few_events_go_on_showing_those_before() -> None:
    compensation, found = run([2000, 2000, 2000, 100])
    assert compensation.hardly_moved and compensation.turns and not compensation.at_rest
    (before, _), (latest, _) = list(compensation._images)[-2:]
    assert latest.count.sum() == pytest.approx(before.count.sum(), rel=1e-3)
    np.testing.assert_array_equal(latest.picture, brightness(latest.sums, 1.0))
    alike = np.corrcoef(latest.picture.ravel(), before.picture.ravel())[0, 1]
    assert alike > 0.99
    # What is seen is where it was a little before, and less certain by that way.
    middle, period = 3.5 * PERIOD, 0.2 * PERIOD
    assert np.abs(found[3].times - middle).max() < period
    np.testing.assert_allclose(found[3].deviations[:, 0], np.hypot(1, 0.525 / COMMON), rtol=1e-6)
    assert (found[3].deviations[:, 1:] == 1).all(), "contours moved along their rows"
    assert (found[2].deviations == 1).all()


def test_pictures_of_more_events_show_these_alone() -> None:
    compensation, found = run([2000, 2000, 2000, 100, 1000])
    assert not compensation.hardly_moved and compensation.turns  # what comes next is not known
    assert compensation._images[-1][0].count.sum() == pytest.approx(1000, rel=1e-3)
    assert (found[4].deviations == 1).all()
    assert not run([2000, 2000, 2000, 100, 1000, 1000])[0].turns


def test_pictures_of_missing_data_show_nothing() -> None:
    """A cluster with few events before the gap hardly moved; in the gap the motion is unknown."""
    compensation, _ = run([2000, 2000, 2000, 500, 0, 500])
    before, gap, after = list(compensation._images)[-3:]
    assert before[0].count.sum() > 1900 and gap[0].count.sum() == 0
    assert after[0].count.sum() == pytest.approx(500, rel=1e-3)  # the way into the gap is unknown
    assert not compensation.hardly_moved


def test_pictures_of_a_camera_that_came_to_rest_go_on_showing_those_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(MissingData, "is_in", lambda missing, cluster: False)
    compensation, _ = run([2000, 2000, 2000, 100, 0, 0])
    assert compensation.hardly_moved and compensation._images[-1][0].count.sum() > 1900


def test_without_little_motion_all_pictures_are_of_new_events() -> None:
    compensation, _ = run([2000, 2000, 2000, 100], little=0.0)
    assert not compensation.hardly_moved
    assert compensation._images[-1][0].count.sum() == pytest.approx(100, rel=1e-3)


def test_thinned_pictures_go_on_as_bright() -> None:
    """Each event of a picture that leaves out half of them stands for two."""
    whole, _ = run([2000, 2000, 2000, 100])
    image = whole._images[-2][0]
    half = replace(image, sums=image.sums / 2, weight=2 * image.weight)
    new = whole._images[-1][0]
    ours, theirs = (one.continued(new, 0.9) for one in (image, half))
    np.testing.assert_allclose(theirs.sums * 2, ours.sums, rtol=1e-5)
    assert np.abs(ours.picture.astype(int) - theirs.picture.astype(int)).max() <= 1


@cache
def back_and_forth() -> SimulatedRecording:
    return simulate(
        SimulationConfig(
            seed=8102,
            motion="back_and_forth",
            duration=1.5,
            resolution=(240, 180),
            focal_length=200.0,
            noise_rate=1.0,
            threshold=0.3,
        )
    )


@pytest.mark.parametrize(("little", "follows"), [(LITTLE, True), (0.0, False)])
def test_landmarks_are_followed_where_the_motion_turns(little: float, follows: bool) -> None:
    """At 1.1 s the camera turns, and no contour has an event for a tenth of a second."""
    values = {"tracking": {"compensation": {"little_motion": little}}}
    odometry = Odometry(back_and_forth().rig, Configuration.model_validate(values))
    odometry.run(back_and_forth())
    inliers = [one.inliers for one in odometry.reports if one.start > 0.2]
    assert (min(inliers) > 40) == follows
