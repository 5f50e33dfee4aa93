"""Tracking event by event on a plane of known motion: positions and their own times."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from front_end_scenes import (
    CAMERA,
    FRAME,
    HEIGHT,
    WIDTH,
    MovingPlane,
    Texture,
    image_of,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpvo import Odometry
from gpvo.config import Configuration, TrackingConfig
from gpvo.config.stages import EventTrackerConfig
from gpvo.events import ClusterEvents, RectifiedEvents, StereoCluster
from gpvo.recordings import Camera, StereoRig
from gpvo.tracking import Observations, make_tracker
from gpvo.tracking.haste import EventTracker
from gpvo.tracking.haste.event_rows import event_rows, events_around, latest_around
from gpvo.tracking.haste.hypotheses import (
    HYPOTHESES,
    STAY,
    Patches,
    follow,
    judge,
    move,
    new_patches,
)
from gpvo.tracking.haste.stereo_matching import best_shift
from gpvo.tracking.haste.templates import align, blur_kernel, correlation, draw, normalized

Array = NDArray[np.float64]
seeds = st.integers(0, 2**32)
KERNEL = blur_kernel(1.0)
ROTATION = 0.07

FRAMES = 5
PLANE = MovingPlane(Texture(7), np.array([0, 0, 0, 0.04, -0.03, 0]))
FLOW = -PLANE.twist[3:5] * CAMERA.fx / PLANE.depth  # pixels per frame, the same everywhere
DISPARITY = CAMERA.fx * CAMERA.baseline / PLANE.depth


@cache
def cluster(frame: int) -> StereoCluster:
    return PLANE.cluster(frame, frame + 1)


def tracked(clusters: list[StereoCluster]) -> list[Observations]:
    tracker = make_tracker(TrackingConfig(tracker="event"))
    return [tracker.track(each) for each in clusters]


@cache
def plane_observations() -> Observations:
    return Observations.concatenate(tracked([cluster(k) for k in range(FRAMES)]))


def motion_since_first(seen: Observations, t: Array) -> tuple[Array, Array]:
    """Compute measured and true motion (N, 2) of left pixels since the first sighting."""
    order = np.lexsort((t, seen.landmark))
    landmark, first = np.unique(seen.landmark[order], return_index=True)
    anchor = order[first][np.searchsorted(landmark, seen.landmark)]
    later = anchor != np.arange(len(seen))
    measured = seen.left - seen.left[anchor]
    true = np.outer((t - t[anchor]) / FRAME, FLOW)
    return measured[later], true[later]


def test_landmarks_move_as_the_plane_at_the_times_of_their_own() -> None:
    seen = plane_observations()
    measured, true = motion_since_first(seen, seen.times[:, 0])
    error = np.linalg.norm(measured - true, axis=1)
    assert len(error) > 300 and error.max() < 0.5 and np.median(error) < 0.1
    assert (measured * true).sum() / (true**2).sum() == pytest.approx(1, abs=0.005)
    np.testing.assert_allclose(seen.disparity, DISPARITY, atol=0.5)
    assert np.median(np.abs(seen.disparity - DISPARITY)) < 0.05


def test_no_time_common_to_a_cluster_is_as_true() -> None:
    """The landmarks' own times leave a smaller error than one time per cluster."""
    seen = plane_observations()
    own = np.linalg.norm(np.subtract(*motion_since_first(seen, seen.times[:, 0])), axis=1)
    mean = np.array([seen.times[seen.frame == k, 0].mean() for k in range(FRAMES)])
    common = np.linalg.norm(np.subtract(*motion_since_first(seen, mean[seen.frame])), axis=1)
    assert np.median(own) < 0.25 * np.median(common)


def test_times_are_those_of_recent_events_and_agree_between_the_cameras() -> None:
    seen, memory = plane_observations(), EventTrackerConfig().memory
    assert (seen.times < FRAME * (seen.frame[:, None] + 1)).all()
    assert (seen.times > FRAME * seen.frame[:, None] - memory).all()
    assert np.abs(np.diff(seen.times)).max() < 0.02  # of 0.1 s


def test_a_landmark_keeps_its_identity_and_is_measured_once_per_cluster() -> None:
    seen = plane_observations()
    pairs = np.unique(np.column_stack([seen.landmark, seen.frame]), axis=0)
    assert len(pairs) == len(seen)
    counts = np.unique(seen.landmark, return_counts=True)[1]
    assert (counts == FRAMES).sum() > 60


def test_same_events_same_observations() -> None:
    again = Observations.concatenate(tracked([cluster(k) for k in range(FRAMES)]))
    for name, column in vars(plane_observations()).items():
        np.testing.assert_array_equal(getattr(again, name), column)


def nothing(start: float, stop: float) -> StereoCluster:
    blank = image_of(RectifiedEvents.empty())
    return StereoCluster(start, stop, blank, blank)


def test_landmarks_wait_while_nothing_moves() -> None:
    """Clusters without events mean that nothing moved."""
    still = [nothing(FRAME, FRAME + k) for k in range(4)]
    pause = 4 * FRAME
    parts = tracked([nothing(0.0, FRAME), cluster(0), *still, late(cluster(1), pause)])
    assert [len(part) for part in parts[2:-1]] == [0] * 4 and len(parts[0]) == 0
    assert len(np.intersect1d(parts[1].landmark, parts[-1].landmark)) > 60


def late(seen: StereoCluster, seconds: float) -> StereoCluster:
    def delayed(image: ClusterEvents) -> ClusterEvents:
        events = image.events()
        return image_of(replace(events, t=events.t + seconds))

    return StereoCluster(
        seen.start + seconds, seen.stop + seconds, delayed(seen.left), delayed(seen.right)
    )


def test_landmarks_that_do_not_move_for_long_are_given_up() -> None:
    tracker = EventTracker(TrackingConfig(event=EventTrackerConfig(patience=2)))
    counts = []
    for k, seen in enumerate([cluster(0), *[nothing(k, k + 1) for k in range(1, 4)]]):
        tracker.track(seen)
        counts.append((k, len(tracker._patches.landmark)))
    assert counts[2][1] == counts[0][1] > 60 and counts[3][1] == 0


def test_events_outside_the_image_change_nothing() -> None:
    """Other sources of clusters may give such events; `rectified_cluster` drops them."""

    def with_stray(image: ClusterEvents) -> ClusterEvents:
        events = image.events()
        stray = np.tile([[-40.0, 3.0], [3.0, HEIGHT + 40.0], [WIDTH + 1e6, -1e6]], (50, 1))
        order = np.argsort(np.concatenate([events.t, np.full(150, events.t[0])]), kind="stable")
        crowd = RectifiedEvents(
            np.concatenate([events.points, stray])[order],
            np.concatenate([events.t, np.full(150, events.t[0])])[order],
            np.concatenate([events.polarity, np.ones(150, bool)])[order],
        )
        return replace(image, events=lambda: crowd)

    clusters = [cluster(k) for k in range(2)]
    crowded = [replace(c, left=with_stray(c.left), right=with_stray(c.right)) for c in clusters]
    for a, b in zip(tracked(clusters), tracked(crowded), strict=True):
        for name, column in vars(a).items():
            np.testing.assert_array_equal(getattr(b, name), column)


def test_swapped_cameras_have_no_landmarks() -> None:
    swapped = [replace(c, left=c.right, right=c.left) for c in map(cluster, range(2))]
    assert sum(map(len, tracked(swapped))) < 0.05 * len(plane_observations())


def test_the_odometry_finds_the_motion_of_the_camera() -> None:
    lens = Camera((WIDTH, HEIGHT), np.array([200.0, 200, 120, 90]), "none", np.zeros(4), np.eye(3))
    rig = StereoRig(lens, lens, CAMERA.fx, (CAMERA.cx, CAMERA.cy), CAMERA.baseline)
    odometry = Odometry(rig, Configuration(tracking=TrackingConfig(tracker="event")))
    for k in range(FRAMES):
        report = odometry.process(cluster(k))
    assert report.inliers > 60 and report.measurements > 60
    trajectory = odometry.trajectory()
    assert trajectory is not None
    velocity = trajectory.velocity(FRAME * (FRAMES - 0.5))
    np.testing.assert_allclose(velocity, PLANE.twist / FRAME, atol=0.02)


def test_configuration_is_checked() -> None:
    with pytest.raises(ValueError, match="min_events"):
        Configuration.model_validate({"tracking": {"event": {"min_events": 401}}})


# Tests of the parts.

CENTRE = np.array([100, 80])


def random_events(seed: int, count: int = 300, spread: float = 15.0) -> Array:
    """Make events (N, 3) on random short lines around (100, 80), in order of time."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-spread, spread, (2, 8, 2))
    line, part = rng.integers(0, 8, count), rng.uniform(0, 1, (count, 1))
    points = ends[0, line] * part + ends[1, line] * (1 - part)
    return np.column_stack([points + CENTRE, np.sort(rng.uniform(0, 0.1, count))])


def rotated(points: Array, pose: Array, motion: Array) -> Array:
    """Move points (N, 2) with a patch from its pose (3,) by (du, dv, angle)."""
    c, s = np.cos(motion[2]), np.sin(motion[2])
    return (points - pose[:2]) @ np.array([[c, s], [-s, c]]) + pose[:2] + motion[:2]


POSE = np.array([100.0, 80.0, 0.3])


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_a_drawing_has_the_weight_and_the_centre_of_its_events(seed: int) -> None:
    events = random_events(seed, spread=10)
    image = draw(events, np.array([100.0, 80.0, 0.0]), (41, 45), KERNEL)
    assert image.sum() == pytest.approx(len(events))
    v, u = np.mgrid[0:41, 0:45]
    centre = np.array([(image * u).sum(), (image * v).sum()]) / len(events) - [22, 20]
    np.testing.assert_allclose(centre + CENTRE, events[:, :2].mean(axis=0), atol=1e-9)


@given(seeds, st.tuples(*[st.floats(-1.2, 1.2)] * 2, st.floats(-0.06, 0.06)))
@settings(deadline=None, max_examples=40)
def test_alignment_finds_the_motion_of_the_events(
    seed: int, motion: tuple[float, float, float]
) -> None:
    events, true = random_events(seed), np.array(motion)
    template = normalized(draw(events, POSE, (33, 33), KERNEL))
    moved = np.column_stack([rotated(events[:, :2], POSE, true), events[:, 2]])
    pose, likeness, deviation = align(moved, template, POSE, KERNEL, 3)
    np.testing.assert_allclose(pose - POSE, true, atol=0.1)
    assert likeness > 0.98 and deviation < 0.1


def test_a_contour_is_not_clear_along_itself() -> None:
    """One direction is undetermined: the deviation shows this, although the patches look alike."""
    rng, pose, deviations = np.random.default_rng(0), POSE * [1, 1, 0], {}
    along = rng.uniform(-30, 30, 400)
    for name, bend in (("line", 0.0), ("corner", 1.0)):
        points = CENTRE + np.column_stack([along, bend * np.abs(along)])
        seen = [
            np.column_stack([points + rng.normal(scale=0.3, size=(400, 2)), np.zeros(400)])
            for _ in range(2)
        ]
        template = normalized(draw(seen[0], pose, (33, 33), KERNEL))
        deviations[name] = align(seen[1], template, pose, KERNEL, 2)[2]
    assert deviations["line"] > 2 * deviations["corner"]


def test_nothing_and_a_blank_template_are_no_match() -> None:
    template = normalized(draw(random_events(0), POSE, (33, 33), KERNEL))
    assert align(np.empty((0, 3)), template, POSE, KERNEL, 3)[1] == -1
    blank = normalized(np.ones((33, 33)))
    assert not np.any(blank)
    assert align(random_events(0), blank, POSE, KERNEL, 3)[1] <= 0


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_correlation_and_best_shift_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    row, template = rng.normal(size=(9, 40)), rng.normal(size=(9, 9))
    expected = [np.corrcoef(row[:, k : k + 9].ravel(), template.ravel())[0, 1] for k in range(32)]
    assert best_shift(row, template) == np.argmax(expected)
    found = correlation(row[:, :9].copy().ravel(), template.ravel())
    assert found == pytest.approx(expected[0])


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_events_are_found_as_by_looking_at_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    events = np.column_stack([rng.uniform(-5, [45, 35], (500, 2)), np.sort(rng.uniform(size=500))])
    rows = event_rows(events, 30)
    row = np.rint(events[:, 1])
    inside = events[(row >= 0) & (row < 30)]
    assert sorted(map(tuple, rows.events)) == sorted(map(tuple, inside))
    centre, half = rng.uniform(-5, [45, 35]), (6.0, 4.0)
    near = (np.abs(inside[:, :2] - centre) <= [6, 4]).all(axis=1)
    now = near & (inside[:, 2] >= 0.2) & (inside[:, 2] <= 0.7)
    found = events_around(rows, 0.2, 0.7, centre, half)
    assert sorted(map(tuple, found)) == sorted(map(tuple, inside[now]))
    square = (np.abs(inside[:, :2] - centre) <= 6).all(axis=1)
    np.testing.assert_array_equal(latest_around(rows, centre, 6.0, 7), inside[square][-7:])


def patches_of(events: Array, window: int = 60) -> Patches:
    """Make a patch at POSE with the appearance of the events, which has not taken any yet."""
    patches = new_patches(33, window, 1)
    patches.pose[0] = POSE
    patches.template[0] = normalized(draw(events, POSE, (33, 33), KERNEL))
    judge(patches, 0, ROTATION)
    return patches


@given(seeds)
@example(24141)  # the present score gets negative, and the patch still stays
@settings(deadline=None, max_examples=20)
def test_scores_are_sums_of_the_template_under_the_window(seed: int) -> None:
    """Scores updated event by event equal those of the plain formula."""
    events = random_events(seed)
    patches = patches_of(events)
    follow(events[:100], patches, ROTATION, 25.0, np.inf)
    expected = np.zeros(HYPOTHESES)
    for h in range(HYPOTHESES):
        pose = POSE.copy()
        move(pose, h, ROTATION)
        local = rotated(events[40:100, :2], pose, np.array([0, 0, -pose[2]])) - pose[:2]
        stay = rotated(events[40:100, :2], POSE, np.array([0, 0, -POSE[2]])) - POSE[:2]
        told = np.abs(stay).max(axis=1) < 15
        values = map_coordinates(patches.template[0], local[told, ::-1].T + 16, order=1)
        expected[h] = values.sum()
    np.testing.assert_allclose(patches.score[0], expected, atol=1e-9)
    np.testing.assert_array_equal(np.sort(patches.window[0, :, 2]), events[40:100, 2])


@pytest.mark.parametrize("hypothesis", [h for h in range(HYPOTHESES) if h != STAY])
def test_a_patch_moves_by_the_hypothesis_that_is_true(hypothesis: int) -> None:
    """The patch ends at most half a step from the true pose, from any direction."""
    events = random_events(3, 800)
    patches, true = patches_of(events, 400), POSE.copy()
    patches.window[0] = events[:400]
    judge(patches, 0, ROTATION)
    move(true, hypothesis, ROTATION)
    moved = np.column_stack([rotated(events[:, :2], POSE, true - POSE), events[:, 2]])
    follow(moved[400:], patches, ROTATION, 25.0, 0.0)
    assert patches.moved[0] and (patches.moving[0, :, 2] <= moved[-1, 2]).all()
    off = np.abs(patches.pose[0] - true)
    assert off[:2].max() < 0.5 and off[2] < 0.5 * ROTATION


def test_events_far_away_leave_a_patch_alone() -> None:
    events = random_events(0)
    patches = patches_of(events)
    follow(events + np.array([40, 0, 0]), patches, ROTATION, 17.0, 0.0)
    assert not patches.moved[0] and not np.isfinite(patches.window).any()
