"""Every tracker follows a textured plane, and a landmark stays the same point of the plane."""

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
    Image,
    MovingPlane,
    Texture,
    cluster_of,
)
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from shown_events import of_surface, shown

from factors import StereoCamera
from gpvo.config import TrackingConfig
from gpvo.config.stages import KltConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.tracking import MultiResolutionTracker, Observations, TrackingReport
from gpvo.tracking.tracker import to_full_resolution
from gpvo.tracking.viso2 import Viso2Tracker
from gpvo.tracking.viso2.tracker import NO_LANDMARK

TRACKERS = ["klt", "viso2"]
FRAMES = 5
THRESHOLDS = {"klt": 50.0, "viso2": 700.0}  # 700 leaves some 900 features to match
# Body twists per frame: to the side, ahead, and turning.
TWISTS = {
    "side": np.array([0, 0, 0, 0.03, -0.02, 0]),
    "ahead": np.array([0, 0, 0, 0, 0, 0.03]),
    "turn": np.array([0.004, -0.01, 0.02, 0.01, 0, 0.01]),
}
TWICE = StereoCamera(400.0, 400.0, 240.5, 180.5, CAMERA.baseline)
"""The camera of the scenes with pixels half as wide."""
PLANES = {name: MovingPlane(Texture(7), twist) for name, twist in TWISTS.items()}


def configuration(tracker: str, **fields: object) -> TrackingConfig:
    features = {"response_threshold": THRESHOLDS[tracker]}
    many = {"max_features": 200}
    return TrackingConfig.model_validate(
        {"tracker": tracker, "image": "binary", "features": features, "klt": many, **fields}
    )


@cache
def images(motion: str, frame: int) -> tuple[Image, Image]:
    return PLANES[motion].images(frame)


@cache
def cluster(motion: str, frame: int, blank: bool = False) -> StereoCluster:
    """Make the contours at the time of a frame, or nothing at that time."""
    left, right = images(motion, frame)
    return cluster_of(left * (not blank), right * (not blank), FRAME * frame)


@cache
def track(
    tracker: str, motion: str, resolutions: tuple[int, ...] = (1, 2), blank: int | None = None
) -> Observations:
    """Return all observations of a moving plane; frame `blank` shows nothing."""
    tracking = MultiResolutionTracker(configuration(tracker, resolutions=resolutions), CAMERA)
    parts = []
    for frame in range(FRAMES):
        parts.append(tracking.track(cluster(motion, frame, frame == blank)))
    return Observations.concatenate(parts)


def test_features_are_given_up_at_once_the_newest_first() -> None:
    tracking = MultiResolutionTracker(configuration("klt", resolutions=(1,)), CAMERA)

    def followed(frame: int) -> list[int]:
        seen = tracking.track(cluster("side", frame))
        return seen.landmark[seen.frame == frame].tolist()

    assert followed(0) == []  # there are new ones, which the next cluster is to confirm
    all_of_them = followed(1)
    most = len(all_of_them) // 2
    tracking.limit_features(most / KltConfig().usual_features)
    fewer = followed(2)
    assert 0.8 * most < len(fewer) <= most and set(fewer) <= set(all_of_them[:most])
    tracking.limit_features(1.0)
    followed(3)
    assert len(followed(4)) > most


@given(st.floats(0, 1), st.integers(1, 500), st.integers(1, 500), st.floats(0, 1e4))
def test_there_are_as_many_features_as_there_is_time_for(
    seconds: float, most: int, usual: int, rate: float
) -> None:
    config = KltConfig(max_features=most, usual_features=usual, feature_rate=rate)
    features = config.features(seconds)
    assert min(usual, most) <= features <= most
    assert features in (usual, most) or abs(features - rate * seconds) < 1


def test_frames_that_are_farther_apart_have_more_features() -> None:
    klt = {"usual_features": 40, "max_features": 160, "feature_rate": 160 / (4 * FRAME)}

    def followed(apart: int, spacing: float = 1.0) -> int:
        tracking = MultiResolutionTracker(configuration("klt", resolutions=(1,), klt=klt), CAMERA)
        tracking.limit_features(1.0, spacing)
        frames = [apart * i for i in range(4)]
        seen = [tracking.track(cluster("ahead", frame)) for frame in frames][-1]
        return int((seen.frame == len(frames) - 1).sum())

    assert followed(1) <= 40 < followed(2) <= 80
    assert followed(2, spacing=2.0) <= 40  # there would be no more time if it were not short


def errors(plane: MovingPlane, seen: Observations) -> tuple[NDArray, NDArray]:
    """Compute distances (N,) from the first sighting's prediction, and disparity errors (N,)."""
    points, disparity = np.empty((len(seen), 3)), np.empty(len(seen))
    for moment in np.unique(seen.frame):
        now = seen.frame == moment
        points[now] = plane.plane_points(moment, seen.left[now])
        disparity[now] = plane.project(moment, points[now])[:, 2]
    order = np.lexsort((seen.frame, seen.landmark))
    landmark, first = np.unique(seen.landmark[order], return_index=True)
    anchor = points[order[first]][np.searchsorted(landmark, seen.landmark)]
    expected = np.empty((len(seen), 2))
    for moment in np.unique(seen.frame):
        now = seen.frame == moment
        expected[now] = plane.project(moment, anchor[now])[:, :2]
    return np.linalg.norm(seen.left - expected, axis=1), np.abs(seen.disparity - disparity)


@pytest.mark.parametrize("motion", TWISTS)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_landmarks_stay_the_same_point_of_the_plane(tracker: str, motion: str) -> None:
    seen = track(tracker, motion)
    drift, disparity_error = errors(PLANES[motion], seen)
    assert np.median(drift) < 0.3 and (drift < 2).mean() > 0.95
    assert np.median(disparity_error) < 0.25 and (disparity_error < 2).mean() > 0.98
    sightings = np.unique(seen.landmark, return_counts=True)[1]
    assert (sightings >= FRAMES - 1).sum() > 200


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_landmark_is_seen_once_per_frame(tracker: str) -> None:
    seen = track(tracker, "turn")
    pairs = np.column_stack([seen.landmark, seen.frame])
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert (seen.disparity > 0).all()
    assert ((seen.left >= -0.5) & (seen.left < [WIDTH + 0.5, HEIGHT + 0.5])).all()
    assert set(seen.frame) == set(range(FRAMES))


@pytest.mark.parametrize("tracker", TRACKERS)
def test_tracking_is_deterministic(tracker: str) -> None:
    first, again = track(tracker, "side"), track.__wrapped__(tracker, "side")
    for name in ("landmark", "frame", "left", "right"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


@pytest.mark.parametrize("tracker", TRACKERS)
def test_resolutions_are_tracked_independently(tracker: str) -> None:
    both = track(tracker, "side", (1, 2))
    for index, resolution in enumerate((1, 2)):
        alone = track(tracker, "side", (resolution,))
        mine = both.landmark % 2 == index
        np.testing.assert_array_equal(both.landmark[mine] // 2, alone.landmark)
        np.testing.assert_array_equal(both.left[mine], alone.left)
        np.testing.assert_array_equal(both.right[mine], alone.right)
        assert len(alone) > 50


def test_half_resolution_pixels_are_the_centre_of_four() -> None:
    four = np.array([[6.0, 8], [7, 8], [6, 9], [7, 9]])
    np.testing.assert_array_equal(to_full_resolution(np.array([[3.0, 4]]), 2)[0], four.mean(axis=0))
    np.testing.assert_array_equal(to_full_resolution(four, 1), four)


def events_of(image: Image, side: int, each_pixel: bool, t: float) -> ClusterEvents:
    """Make the events, all at time t, of a picture that is shown `side` times as large.

    They are at each pixel, or in the middle of each white pixel of the picture, one for each of
    the sensor's pixels in it.
    """
    if each_pixel:
        large = np.kron(image, np.ones((side, side), np.uint8))
        return of_surface(np.where(large > 0, t, -np.inf))
    points = to_full_resolution(np.argwhere(image)[:, ::-1].astype(np.float64), side)
    points = np.repeat(points, side**2, axis=0)
    height, width = image.shape
    return shown(points, np.full(len(points), t), (side * height, side * width))


@pytest.mark.parametrize("image", ["binary", "motion_compensated"])
def test_half_the_resolution_of_a_picture_twice_as_large_is_the_picture(image: str) -> None:
    """What is tracked at half the resolution is found where it is at the full one.

    All events are drawn: half as many pixels of each side have enough of fewer.
    """
    small, large = (
        MultiResolutionTracker(
            configuration("klt", image=image, resolutions=(side,), compensation={"density": None}),
            camera,
        )
        for side, camera in ((1, CAMERA), (2, TWICE))
    )
    frames: list[int] = []
    for frame in range(3):
        start = FRAME * frame
        t = start + FRAME / 2 + 1 / 64  # sums of such times are exact
        one, two = (
            small_or_large.track(
                StereoCluster(
                    start,
                    start + FRAME,
                    *(events_of(one, side, image == "binary", t) for one in images("side", frame)),
                )
            )
            for small_or_large, side in ((small, 1), (large, 2))
        )
        np.testing.assert_array_equal(one.landmark, two.landmark)
        np.testing.assert_allclose(to_full_resolution(one.left, 2), two.left, atol=1e-9)
        np.testing.assert_allclose(2 * one.disparity, two.disparity, atol=1e-9)
        np.testing.assert_array_equal(one.times, two.times)
        frames += one.frame.tolist()
    assert (np.bincount(frames, minlength=3) > 100).all()


@pytest.mark.parametrize("tracker", TRACKERS)
def test_the_report_counts_what_was_found(tracker: str) -> None:
    tracking = MultiResolutionTracker(configuration(tracker, resolutions=(1, 2)), CAMERA)
    before = TrackingReport(0, 0, 0, 0)
    for frame in range(3):
        seen, report = tracking.track(cluster("side", frame)), tracking.report
        here = (seen.frame == frame).sum()
        found = tracker == "viso2" or frame > 0
        assert (0 < report.stereo <= report.features) == found
        assert report.closed <= report.known and (report.closed > 100) == (frame > 0)
        assert not report.at_rest
        if tracker == "klt":  # every landmark was followed, or is new in the cluster before
            assert here == report.closed
            assert report.known == report.stereo + before.closed
        else:
            assert report.known == before.features
            assert frame != 1 or here <= report.closed
        before = report


def test_reports_add_up() -> None:
    one, two = TrackingReport(10, 5, 8, 4, True), TrackingReport(1, 2, 3, 4, False)
    assert one + two == TrackingReport(11, 7, 11, 8, False)


@pytest.mark.parametrize("blank", [0, 2, FRAMES - 1])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_cluster_without_events_is_no_error(tracker: str, blank: int) -> None:
    seen = track(tracker, "side", (1,), blank)
    assert not (seen.frame == blank).any()
    assert len(np.unique(seen.frame)) == FRAMES - 1


def test_landmarks_do_not_come_back_in_another_scene() -> None:
    """A few of their patches match there by chance."""
    tracking = MultiResolutionTracker(configuration("klt", resolutions=(1,)), CAMERA)
    other = MovingPlane(Texture(8), TWISTS["side"])
    others = (cluster_of(*other.images(frame), FRAME * frame) for frame in (2, 3))
    clusters = [cluster("side", 0), cluster("side", 0, blank=True), *others]
    seen = Observations.concatenate(map(tracking.track, clusters))
    before, after = seen.landmark[seen.frame == 0], seen.landmark[seen.frame > 1]
    assert len(before) > 40 and len(after) > 40
    assert not set(before) & set(after)


def test_descriptor_tracklets_reach_over_a_blank_frame() -> None:
    seen = track("viso2", "side", (1,), 2)
    before, after = (set(seen.landmark[seen.frame == frame]) for frame in (1, 3))
    assert len(before & after) > 20


def test_descriptor_tracker_forgets_landmarks_out_of_reach() -> None:
    config = configuration("viso2", earlier_frames=2)
    tracker, counts = Viso2Tracker(config), []
    for frame in [0, 1, 2, 3, 4, 3, 2, 1, 0]:
        tracker.track(*images("side", frame))
        counts.append(len(tracker._references))
        within_reach = {int(k) for seen in tracker._frames for k in seen.landmark} - {NO_LANDMARK}
        assert set(tracker._references) == within_reach
    assert 0 < counts[-1] < tracker._landmark_count


@pytest.mark.parametrize("tracker", TRACKERS)
def test_swapped_cameras_have_no_landmarks(tracker: str) -> None:
    """A negative disparity is never a match, so only chance matches are left."""
    tracking = MultiResolutionTracker(configuration(tracker), CAMERA)
    found = 0
    for frame in range(3):
        shown = cluster("side", frame)
        found += len(tracking.track(replace(shown, left=shown.right, right=shown.left)))
    honest = (track(tracker, "side").frame < 3).sum()
    assert found < 0.1 * honest
