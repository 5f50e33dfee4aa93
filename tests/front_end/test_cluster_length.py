"""Clusters are as long as contours need to move by a distance, at any speed and on any sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpvo.config import ClusteringConfig
from gpvo.events.cluster_length import (
    APART,
    BLIND,
    FAINT,
    FIRST,
    LEAST,
    REMEMBERED,
    SHORT,
    SURGE,
    ClusterLength,
    ImageMotion,
)
from gpvo.recordings import Camera, StereoRig

UNKNOWN = ImageMotion()
SIZES = [(240, 180), (346, 260), (1280, 720)]


def length(size: tuple[int, int], **fields: float) -> ClusterLength:
    camera = Camera(size, np.array([200.0, 200, 8, 6]), "none", np.zeros(4), np.eye(3))
    rig = StereoRig(camera, camera, 200.0, (8.0, 6.0), 0.1)
    return ClusterLength(ClusteringConfig.model_validate(fields), rig)


ACCELERATION = st.floats(0, 1e6) | st.just(np.inf)
KNOWN = st.builds(ImageMotion, st.floats(0, 1e5), ACCELERATION, ACCELERATION)
MOTION = st.builds(ImageMotion, st.none(), ACCELERATION) | KNOWN


@given(st.floats(0, 1e5), st.floats(0.5, 5), st.floats(0.02, SHORT), st.floats(0, 0.02))
def test_contours_move_by_the_motion_within_a_cluster_of_bounded_duration(
    speed: float, motion: float, window: float, shortest: float
) -> None:
    limits = length((240, 180), motion=motion, window=window, shortest=shortest).limits
    duration, _ = limits(ImageMotion(speed, density=0.0))
    assert shortest <= duration <= window
    at_bound = duration in (shortest, window)
    assert at_bound or duration * speed == pytest.approx(motion)


@given(st.floats(0, 1e6), st.floats(0.01, 1), st.floats(0, 0.02), st.floats(0.02, 0.1))
def test_contours_in_fast_motion_leave_a_constant_one_by_the_blur_within_a_cluster(
    acceleration: float, blur: float, shortest: float, steady: float
) -> None:
    limits = length((240, 180), blur=blur, shortest=shortest, steady=steady).limits
    duration, _ = limits(ImageMotion(1e9, acceleration, 0.0))
    assert shortest <= duration <= steady
    at_bound = duration in (shortest, steady)
    assert at_bound or acceleration * (duration / 2) ** 2 / 2 == pytest.approx(blur)


@given(st.floats(0.5, 5), st.floats(0.1, 10), st.floats(0, 1e4))
def test_slow_contours_move_as_far_while_they_accelerate(
    motion: float, speed: float, acceleration: float
) -> None:
    limits = length((240, 180), motion=motion, window=10.0, blur=1e-9).limits
    duration, _ = limits(ImageMotion(speed, acceleration, 0.0))
    moved = duration * speed + acceleration * duration**2 / 2
    shortest = min(SHORT, motion / speed)
    assert shortest <= duration <= 10.0
    assert duration == pytest.approx(shortest) or duration == 10.0 or moved == pytest.approx(motion)


@pytest.mark.parametrize("motion", [UNKNOWN, ImageMotion(10.0, 1e6)])
def test_slow_motion_with_few_events_has_time_for_enough(motion: ImageMotion) -> None:
    known, pixels = length((240, 180)), 240 * 180
    assert known.limits(motion)[0] == SHORT
    known.add(pixels, LEAST * pixels / 2, SHORT)  # half of what is enough, the others are noise
    assert known.limits(motion)[0] == pytest.approx(2 * SHORT)
    assert known.limits(UNKNOWN, at_rest=True)[0] == SHORT
    fast = ImageMotion(44.0, 1e6, density=0.0)
    assert known.limits(fast)[0] == pytest.approx(0.05)  # not in fast motion
    known.add(pixels, pixels, SHORT)
    assert known.limits(motion)[0] == SHORT


def test_fast_motion_has_time_for_the_events_that_show_it() -> None:
    """However sharply it changes, but no longer than in motion that does not."""
    known, pixels, fast = length((240, 180)), 240 * 180, ImageMotion(1e3, 1e9, density=0.0)
    durations = []
    for share in (2.0, 0.5, 0.1):  # of what is enough in 15 ms
        known.add(pixels, share * FAINT * pixels, 0.015)
        durations.append(known.limits(fast)[0])
    assert durations == pytest.approx([0.01, 0.03, 0.05])


@given(st.floats(0.05, 0.95), st.floats(0, 2))
def test_enough_events_end_the_cluster_of_a_motion_that_begins(share: float, noise: float) -> None:
    """Where it was slow it lasts longer, but not long, and until there are enough contours."""
    known, pixels = length((240, 180), window=10.0), 240 * 180
    contours, others = share * LEAST * pixels, round(noise * LEAST * pixels)
    known.add(round(contours) + others, contours, SHORT)
    duration, most = known.limits(UNKNOWN)
    assert duration == pytest.approx(min(SHORT / share, BLIND))
    assert most == pytest.approx(LEAST * pixels + others / share, abs=20)


def test_only_slow_motion_that_is_known_has_the_longest_clusters() -> None:
    known, slow = length((240, 180), window=0.8), ImageMotion(1e-3, 0.0, 0.0)
    assert known.limits(slow)[0] == 0.8
    assert known.limits(slow, at_rest=True)[0] == BLIND
    known.add(1, 1.0, SHORT)
    assert known.limits(UNKNOWN)[0] == BLIND


@given(st.floats(0, 1e5), st.floats(0.5, 5), st.floats(0.001, 0.05), st.floats(0, 2))
def test_contours_move_by_the_motion_where_only_their_acceleration_is_known(
    acceleration: float, motion: float, steady: float, rate: float
) -> None:
    """At most, unless that takes less time than a cluster of steady motion has."""
    known, pixels = length((240, 180), motion=motion, steady=steady), 240 * 180
    known.add(round(rate * pixels), rate * pixels, 1.0)
    duration, most = known.limits(ImageMotion(acceleration=acceleration))
    longest, unbounded = known.limits(UNKNOWN)
    assert duration <= longest and most == unbounded
    moved = acceleration * duration**2 / 2
    assert duration in (steady, longest) or moved == pytest.approx(motion)
    assert duration == steady or moved <= motion * (1 + 1e-9)


@given(st.floats(22, 1e5), ACCELERATION)
def test_the_longer_of_both_times_counts(speed: float, acceleration: float) -> None:
    limits = length((240, 180)).limits
    both, *alone = (
        limits(ImageMotion(*motion, density=0.0))[0]
        for motion in ((speed, acceleration), (speed, np.inf), (1e9, acceleration))
    )
    assert both == max(alone)


@given(st.floats(1, 1e3), st.floats(1, 1e5), st.floats(0, 1e9), st.floats(0, 20))
def test_clusters_of_lively_motion_are_shorter_as_far_as_that_leaves_a_picture(
    speed: float, acceleration: float, density: float, rate: float
) -> None:
    """The image half-way between begins twice as far apart is known to the uncertainty."""
    lively, pixels = length((240, 180)), 240 * 180
    lively.add(round(rate * pixels), rate * pixels, 1.0)
    config, motion = ClusteringConfig(), ImageMotion(speed, acceleration, density)
    duration, _ = lively.limits(motion)
    shortest, _ = lively.limits(replace(motion, density=np.inf))
    longest, _ = lively.limits(replace(motion, density=0.0))
    assert shortest <= duration <= longest
    if shortest < duration < longest:
        off = np.sqrt(density * (2 * duration) ** 3 / 192)
        assert off == pytest.approx(config.uncertainty)
    if shortest < longest:
        assert rate * shortest >= config.picture * (1 - 1e-9)
        way, steady = speed * shortest, config.lively_steady
        assert way >= config.lively_motion * (1 - 1e-9) or shortest > SHORT or shortest >= steady


@given(st.floats(0.01, 0.1), st.floats(1, 4), KNOWN)
def test_clusters_are_apart_while_the_motion_is_slow_and_expected(
    duration: float, spacing: float, motion: ImageMotion
) -> None:
    """At most, the image moves by the stride, its deviation half-way is the uncertainty, and it
    leaves a constant motion by twice the blur."""
    config = ClusteringConfig(spacing=spacing)
    period = length((640, 480), spacing=spacing).period(duration, motion)
    assert duration <= period <= spacing * duration
    moved = motion.speed * period / config.stride
    off = np.sqrt(motion.density * period**3 / 192) / config.uncertainty
    left = motion.acceleration * (period / 2) ** 2 / 2 / (APART * config.blur)
    if duration < period < spacing * duration:
        assert max(moved, off, left) == pytest.approx(1.0)
    elif period == duration < spacing * duration:
        assert max(moved, off, left) >= 1 - 1e-9


def test_clusters_follow_each_other_until_the_noise_of_the_motion_is_known() -> None:
    assert length((640, 480)).period(0.05, ImageMotion(10.0)) == 0.05


@pytest.mark.parametrize("size", SIZES)
def test_events_end_a_cluster_while_the_speed_is_unknown(size: tuple[int, int]) -> None:
    pixels = size[0] * size[1]
    assert length(size).limits(UNKNOWN) == (SHORT, round(FIRST * pixels))
    assert length(size).limits(ImageMotion(50.0))[1] == round(LEAST * pixels)


def test_a_cluster_of_the_smallest_sensor_waits_for_an_event() -> None:
    """No event ends one of none, and what asks for it found no time of it."""
    assert length((1, 1)).limits(UNKNOWN)[1] == length((1, 1)).limits(ImageMotion(50.0))[1] == 1


def test_a_surge_of_events_ends_a_cluster() -> None:
    known = length((240, 180))
    for events in [*[10**6] * REMEMBERED, *[30_000] * REMEMBERED]:
        known.add(events, events, 0.05)
    assert known.limits(ImageMotion(50.0))[1] == SURGE * 30_000
    known.add(10**9, 10**9, 0.05)  # one cluster does not say what is usual
    assert known.limits(ImageMotion(50.0))[1] == SURGE * 30_000


@given(MOTION)
def test_a_number_of_events_that_is_set_is_the_only_one(motion: ImageMotion) -> None:
    fixed = length((240, 180), max_events=5000, window=0.2)
    fixed.add(10**6, 10**6, 0.05)
    assert fixed.limits(motion) == (0.2, 5000)
