"""After a gap, in which the camera went anywhere, landmarks are known again, and the pose is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from front_end_scenes import random_picture, track
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.config import TrackingConfig
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.sights import Sights, predict

Array = NDArray[np.float64]

CAMERA = StereoCamera(150.0, 150.0, 100.0, 80.0, 0.1)
WIDTH, HEIGHT, DEPTH = 200, 160, 1.8
PER_METRE, MIDDLE = 80.0, 300.0
"""Pixels of the plane's picture, 600 x 600."""
BEFORE = [se3_exp([0, 0, 0, 0.02 * k, 0, 0]) for k in range(6)]
MOTIONS = {
    "none": np.zeros(6),
    "sideways": np.array([0, 0, 0, 0.7, 0.1, 0]),
    "ahead": np.array([0, 0, 0, 0, 0, 0.5]),
    "yaw": np.array([0, 0.3, 0, 0.1, 0, 0]),
    "roll": np.array([0, 0, 0.5, 0, 0, 0]),
    "any": np.array([0.15, -0.15, 0.2, 0.2, -0.2, -0.2]),
}

LITTLE = ("ahead", 0)
"""Without a blank picture a tenth is followed: in the middle it hardly moves ahead."""


def plane(seed: int) -> NDArray[np.uint8]:
    return random_picture(seed, (600, 600))


def seen(picture: NDArray[np.uint8], T: Array) -> NDArray[np.uint8]:
    """Render a plane at z = DEPTH in the world as a left camera at the pose T sees it."""
    intrinsic = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1.0]])
    metres = np.diag([1 / PER_METRE, 1 / PER_METRE, 1.0])
    metres[:2, 2] = -MIDDLE / PER_METRE
    T_cam_world = se3_inverse(T)
    on_plane = T_cam_world[:3, [0, 1, 3]].copy()
    on_plane[:, 2] += DEPTH * T_cam_world[:3, 2]
    image = cv2.warpPerspective(picture, intrinsic @ on_plane @ metres, (WIDTH, HEIGHT))
    return np.asarray(image, np.uint8)


def track_over_a_gap(
    motion: Array, after: int = 5, blanks: int = 3
) -> tuple[KltTracker, Sights, Array]:
    """Track a plane, nothing, and the plane `after` from a pose that the tracker does not know.

    Returns the tracker, the landmarks of the last frame that were seen before the gap, and how far
    they are from where they should be (N,), pixels.
    """
    config = TrackingConfig.model_validate({"klt": {"min_row_gradient": 0}})
    tracker, blank = KltTracker(config, CAMERA), np.full((HEIGHT, WIDTH), 90, np.uint8)
    baseline = se3_exp([0, 0, 0, CAMERA.baseline, 0, 0])
    for T in BEFORE:
        tracker.T_start_cam = T
        before = track(tracker, seen(plane(5), T), seen(plane(5), T @ baseline))
    for _ in range(blanks):
        assert len(track(tracker, blank, blank)) == 0
    T = BEFORE[-1] @ se3_exp(motion)
    now = track(tracker, seen(plane(after), T), seen(plane(after), T @ baseline))
    _, i, j = np.intersect1d(before.landmark, now.landmark, return_indices=True)
    there = predict(CAMERA, T, Sights.of_frame(before.left, before.right, BEFORE[-1]))
    return tracker, there, np.linalg.norm(there[i, :2] - now.left[j], axis=1)


@pytest.mark.parametrize(
    ("motion", "blanks"),
    [(motion, blanks) for motion in MOTIONS for blanks in (0, 3) if (motion, blanks) != LITTLE],
)
def test_landmarks_and_the_pose_are_known_again(motion: str, blanks: int) -> None:
    """Also without a blank picture: what is alike by chance then is no match."""
    tracker, there, error = track_over_a_gap(MOTIONS[motion], blanks=blanks)
    inside = ((there[:, :2] > 10) & (there[:, :2] < [WIDTH - 10, HEIGHT - 10])).all(axis=1)
    assert len(error) > 0.5 * inside.sum() > 10
    assert np.median(error) < 0.2 and error.max() < 2.0
    T = BEFORE[-1] @ se3_exp(MOTIONS[motion])
    np.testing.assert_allclose(se3_log(se3_inverse(T) @ tracker.T_start_cam), 0, atol=0.02)


def test_nothing_is_known_again_in_another_scene() -> None:
    tracker, _, error = track_over_a_gap(MOTIONS["none"], after=6)
    assert len(error) <= 2
    np.testing.assert_array_equal(tracker.T_start_cam, BEFORE[-1])
