"""Anchors are found again where they are, turned, enlarged, darker, and not elsewhere."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from front_end_scenes import random_picture, track
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp
from gpvo.config import TrackingConfig
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.klt.anchors import Anchors, match_anchors
from gpvo.tracking.klt.lucas_kanade import Pyramid
from gpvo.tracking.sights import UPRIGHT, Sights

SIDE = 31
SHAPE = (160, 200)
seeds = st.integers(0, 2**32)


def texture(seed: int) -> NDArray[np.uint8]:
    return random_picture(seed, SHAPE)


def pyramid(image: NDArray[np.uint8]) -> Pyramid:
    return Pyramid.of_image(image, SIDE, 1)


def anchors_at(image: NDArray[np.uint8], points: NDArray[np.float64]) -> Anchors:
    left = points.astype(np.float32)
    sights = Sights.of_frame(left, left - np.float32([10.0, 0.0]), np.eye(4))
    return Anchors.of_image(pyramid(image), sights)


@given(
    seeds,
    st.floats(-0.6, 0.6),
    st.floats(0.75, 1.4),
    st.floats(0.3, 1.0),
    st.floats(0, 60),
)
@settings(deadline=None, max_examples=40)
def test_a_warped_and_darker_image_is_matched(
    seed: int, angle: float, scale: float, gain: float, bias: float
) -> None:
    rng, image = np.random.default_rng(seed), texture(seed)
    middle = np.array([100.0, 80.0])
    A = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = middle + rng.uniform(-20, 20, (6, 2))
    moved = (points - middle) @ A.T + middle + [3.3, -2.2]
    matrix = np.column_stack([A, middle - A @ middle + [3.3, -2.2]])
    warped = cv2.warpAffine(image, matrix, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT_101)
    now = np.clip(gain * warped + bias, 0, 255).astype(np.uint8)
    guess = (moved + rng.uniform(-0.7, 0.7, moved.shape)).astype(np.float32)
    found, alike = match_anchors(
        anchors_at(image, points), np.tile(np.vstack([A, [0, 0]]), (6, 1, 1)), pyramid(now), guess
    )
    assert (alike > 0.9).all()
    assert np.linalg.norm(found - moved, axis=1).max() < 0.15


@given(seeds, st.floats(-0.004, 0.004), st.floats(-0.004, 0.004))
@settings(deadline=None, max_examples=40)
def test_a_surface_that_is_seen_aslant_is_matched(seed: int, across: float, down: float) -> None:
    """The warp of a turned camera is no affine one: its borders are magnified otherwise."""
    image, point, h = texture(seed), np.array([[100.0, 80.0]]), np.array([across, down])
    to_point = np.array([[1, 0, -100.0], [0, 1, -80.0], [0, 0, 1]])
    H = np.linalg.inv(to_point) @ np.array([[1, 0, 0], [0, 1, 0], [*h, 1]]) @ to_point
    now = cv2.warpPerspective(image, H, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT_101)
    warps = np.vstack([np.eye(2), h])[None]
    guess = point.astype(np.float32) + np.float32([0.6, -0.4])
    found, alike = match_anchors(anchors_at(image, point), warps, pyramid(now), guess)
    assert alike[0] > 0.98
    assert np.linalg.norm(found - point) < 0.05


def test_another_image_does_not_look_alike() -> None:
    points = np.random.default_rng(1).uniform([40, 40], [160, 120], (50, 2))
    guess = points.astype(np.float32)
    warps = np.tile(UPRIGHT, (50, 1, 1))
    _, alike = match_anchors(anchors_at(texture(1), points), warps, pyramid(texture(2)), guess)
    assert (alike < 0.6).all()


@pytest.mark.parametrize("content", ["blank", "beyond"])
def test_nothing_is_found_without_contrast_or_beyond_the_image(content: str) -> None:
    image, points = texture(1), np.array([[100.0, 80.0]])
    guess = points.astype(np.float32) + (1000 if content == "beyond" else 0)
    seen = np.full(SHAPE, 80, np.uint8) if content == "blank" else image
    _, alike = match_anchors(anchors_at(seen, points), np.eye(2)[None], pyramid(image), guess)
    assert alike.tolist() == [-1.0]


def drift_of_tracks(anchor_correlation: float) -> float:
    """Track a noisy image of a camera that turns; return the median drift over 30 frames, pixels.

    The camera turns around its axis before a plane at the disparity 8.
    """
    config = TrackingConfig.model_validate(
        {"klt": {"anchor_correlation": anchor_correlation, "min_row_gradient": 0}}
    )
    tracker = KltTracker(config, StereoCamera(150.0, 150.0, 100.0, 80.0, 0.1))
    clean, rng = texture(5), np.random.default_rng(6)
    for number in range(30):
        turned = cv2.getRotationMatrix2D((100.0, 80.0), 1.0 * number, 1.0)
        stereo = [
            cv2.warpAffine(clean, turned - [[0, 0, d], [0, 0, 0]], SHAPE[::-1], borderMode=4)
            for d in (0, 8)
        ]
        noisy = (np.clip(side + rng.normal(0, 30, SHAPE), 0, 255) for side in stereo)
        tracker.T_start_cam = se3_exp([0, 0, np.deg2rad(number), 0, 0, 0])
        seen = track(tracker, *(side.astype(np.uint8) for side in noisy))
        if number == 0:
            first = seen
    _, i, j = np.intersect1d(first.landmark, seen.landmark, return_indices=True)
    assert len(i) > 10
    expected = first.left[i] @ turned[:, :2].T + turned[:, 2]
    return float(np.median(np.linalg.norm(seen.left[j] - expected, axis=1)))


def test_anchors_keep_tracks_from_drifting() -> None:
    assert drift_of_tracks(0.6) < 0.6 * drift_of_tracks(1.0)
