"""Landmarks that left the view keep their identities when the camera comes back."""

from __future__ import annotations

import numpy as np
import pytest
from front_end_scenes import random_picture, track
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config import TrackingConfig
from gpvo.tracking import Observations
from gpvo.tracking.klt import KltTracker

CAMERA = StereoCamera(150.0, 150.0, 100.0, 80.0, 0.1)
SHAPE = HEIGHT, WIDTH = 160, 200
DISPARITY = 8
METRES = CAMERA.baseline / DISPARITY
"""Way of the camera that moves the plane's image by a pixel."""
SLOW = [0, 5, 10, 15, 20, 25]
AWAY = [65, 105, 145, 185, 225, 265, 305]
"""Columns of the plane at the left of the image: out of its first view, which is 200 wide."""


def plane(seed: int) -> NDArray[np.uint8]:
    return random_picture(seed, (HEIGHT, 600))


def tracked(
    columns: list[int], drifted: float = 0.0, back: int = 5, lost_landmarks: int = 300
) -> list[Observations]:
    """Track a plane at these columns; later ones show the plane `back`, the pose off by pixels."""
    # The strongest features: of those that tell most of the pose one of 175 was last seen at the
    # border, with a wrong disparity, and is searched, and found, 4 pixels beside its place.
    klt = {"min_row_gradient": 0, "lost_landmarks": lost_landmarks, "candidates": 1}
    config = TrackingConfig.model_validate({"klt": klt})
    tracker, seen = KltTracker(config, CAMERA), []
    for number, column in enumerate(columns):
        later = number >= len(SLOW + AWAY)
        image = plane(back if later else 5)
        tracker.T_start_cam = np.eye(4)
        tracker.T_start_cam[0, 3] = METRES * (column + drifted * later)
        left, right = (image[:, start : start + WIDTH] for start in (column, column + DISPARITY))
        seen.append(track(tracker, np.ascontiguousarray(left), np.ascontiguousarray(right)))
    return seen


def known_again(seen: list[Observations], first: int) -> tuple[int, NDArray[np.float64]]:
    """Count the landmarks of a frame, and return how far (N,) the latest sights are from there."""
    before, now = seen[first], seen[-1]
    _, i, j = np.intersect1d(before.landmark, now.landmark, return_indices=True)
    return len(before.landmark), np.linalg.norm(now.left[j] - before.left[i], axis=1)


@pytest.mark.parametrize("drifted", [0.0, 1.5, -3.0, 6.0])
def test_landmarks_are_known_again(drifted: float) -> None:
    """The same columns as at the beginning are in view at the end, and none of them between."""
    seen = tracked(SLOW + AWAY + [25, 20, 15], drifted)
    count, error = known_again(seen, SLOW.index(15))
    assert len(error) > 0.5 * count > 20
    assert np.median(error) < 0.1 and error.max() < 0.5


def test_none_is_known_again_if_none_is_remembered() -> None:
    seen = tracked(SLOW + AWAY + [25, 20, 15], lost_landmarks=0)
    assert len(known_again(seen, SLOW.index(15))[1]) == 0


def test_few_are_taken_for_known_in_another_scene() -> None:
    seen = tracked(SLOW + AWAY + [25, 20, 15], back=6)
    count, error = known_again(seen, SLOW.index(15))
    assert len(error) <= 0.05 * count


def test_identities_are_unique_and_the_number_of_landmarks_is_limited() -> None:
    for frame in tracked(SLOW + AWAY + AWAY[::-1] + SLOW[::-1]):
        assert len(np.unique(frame.landmark)) == len(frame.landmark) <= 200
