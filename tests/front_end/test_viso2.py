"""Parts of LIBVISO2 that the tracker combines, and the effect of switching each."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from front_end_scenes import MovingPlane, Texture

from gpvo.config import TrackingConfig
from gpvo.tracking.viso2 import Viso2Tracker
from gpvo.tracking.viso2.tracker import NO_LANDMARK

FRAMES = 3
PLANE = MovingPlane(Texture(7), np.array([0.004, -0.01, 0.02, 0.03, 0, 0.01]))


@cache
def images(frame: int) -> tuple[np.ndarray, np.ndarray]:
    return PLANE.images(frame)


def tracked(threshold: float = 300.0, **fields: object) -> Viso2Tracker:
    """Run a tracker over some frames."""
    features = {"response_threshold": threshold}
    tracker = Viso2Tracker(TrackingConfig.model_validate({"features": features, "viso2": fields}))
    for frame in range(FRAMES):
        tracker.track(*images(frame))
    return tracker


def shared_landmarks(tracker: Viso2Tracker) -> set[int]:
    """Return the landmarks of both the latest frame and the one before."""
    before, latest = (set(frame.landmark.tolist()) for frame in list(tracker._frames)[-2:])
    return (before & latest) - {NO_LANDMARK}


def true_share(tracker: Viso2Tracker) -> float:
    """Compute the share of shared landmarks that stay the same point of the plane, to 3 pixels."""
    before, latest = list(tracker._frames)[-2:]
    distance = []
    for landmark in shared_landmarks(tracker):
        first, second = (
            frame.features.left.features.points[frame.landmark == landmark].astype(float)
            for frame in (before, latest)
        )
        point = PLANE.plane_points(before.number, first)
        distance.append(np.linalg.norm(PLANE.project(latest.number, point)[:, :2] - second))
    return float((np.array(distance) < 3).mean())


def test_two_stages_find_more_where_the_search_is_wide() -> None:
    """One stage meets more similar features; nearly all matches of two stages are true."""
    one, two = (tracked(two_stage=on, flow_radius=80) for on in (False, True))
    assert len(shared_landmarks(two)) >= 1.05 * len(shared_landmarks(one)) > 200
    assert true_share(two) > 0.95


def test_ranges_hold_the_motion_of_landmarks_between_frames_far_apart() -> None:
    """The first and the latest frame match, and no feature is in two quads."""
    tracker = tracked()
    first, *_, latest = tracker._frames
    quads = tracker._match(latest, first)
    assert len(quads) > 100 and len(np.unique(quads[:, 0])) == len(quads)


@pytest.mark.parametrize("count", [1, 3])
def test_no_cell_has_more_new_landmarks_than_its_bucket_holds(count: int) -> None:
    latest = tracked(bucket_features=count, bucket_size=40)._frames[-1]
    points = latest.features.left.features.points[latest.landmark != NO_LANDMARK]
    number = np.unique(points // 40, axis=0, return_counts=True)[1]
    assert number.max() == count and len(number) > 10


def test_buckets_prefer_what_was_seen_before() -> None:
    """The latest frame continues most landmarks of the one before, although there are few."""
    few, all_ = tracked(bucket_features=1, bucket_size=40), tracked()
    before, latest = list(few._frames)[-2:]
    assert len(shared_landmarks(few)) < 0.5 * len(shared_landmarks(all_))
    known = set(before.landmark.tolist()) - {NO_LANDMARK}
    new = set(latest.landmark.tolist()) - known - {NO_LANDMARK}
    assert len(shared_landmarks(few)) > 2 * len(new)


def test_features_of_smoothed_frames_are_found_again() -> None:
    """Binary contours are ragged, so a larger share of the features of blurred ones matches."""
    raw, blurred = tracked(1500, smoothing=0), tracked(300)
    shares = [
        len(shared_landmarks(tracker)) / len(tracker._frames[-1].landmark)
        for tracker in (raw, blurred)
    ]
    assert shares[1] > 1.2 * shares[0]


@pytest.mark.parametrize("refinement", ["none", "pixel"])
def test_unrefined_positions_are_whole_pixels(refinement: str) -> None:
    config = {"features": {"response_threshold": 300}, "viso2": {"refinement": refinement}}
    tracker = Viso2Tracker(TrackingConfig.model_validate(config))
    for frame in range(2):
        seen = tracker.track(*images(frame))
    assert len(seen) > 200
    for side in (seen.left, seen.right):
        np.testing.assert_array_equal(side, np.rint(side))
