"""Slopes of surfaces that are seen at an angle, from how left and right patches differ."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from front_end_scenes import random_picture, track
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from factors import StereoCamera
from factors.lie import se3_exp
from gpvo.config import TrackingConfig
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.klt.lucas_kanade import BEYOND, Pyramid
from gpvo.tracking.klt.surfaces import (
    ALIKE,
    LEAST_NOISE,
    SLANT,
    fit_surfaces,
    match_on_surfaces,
)

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

SIDE, SHAPE, FOCAL_LENGTH = 27, (160, 200), 200.0
DISPARITY = 14.0
MIDDLE = np.array([100.0, 80.0])
RIGHT = np.array([1.0, 0.0, 0.0])
POINTS = np.float32([[u, v] for u in (70, 85, 100, 115, 130) for v in (60, 80, 100)])
seeds = st.integers(0, 2**32)
slopes_of_planes = st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12)).map(np.array)


def pyramid(image: Image) -> Pyramid:
    return Pyramid.of_image(image, SIDE, 1)


def stereo(seed: int, slope: Array, gain: float = 1.0) -> tuple[Pyramid, Pyramid]:
    """Draw a picture on a plane of a slope, with DISPARITY in the middle of the image."""
    image, start = random_picture(seed, SHAPE), slope @ MIDDLE - DISPARITY
    to_right = np.array([[1 - slope[0], -slope[1], start], [0.0, 1.0, 0.0]])
    right = cv2.warpAffine(image, to_right, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT_101)
    return pyramid(image), pyramid(np.rint(gain * right).astype(np.uint8))


def in_right(slope: Array) -> NDArray[np.float32]:
    """Where the points are in the right image."""
    disparity = DISPARITY + (POINTS - MIDDLE) @ slope
    return (POINTS - disparity[:, None] * [1, 0]).astype(np.float32)


@given(seeds, slopes_of_planes, st.floats(0.4, 1.0))
@settings(deadline=None, max_examples=40)
def test_planes_are_found(seed: int, slope: Array, gain: float) -> None:
    images, expected = stereo(seed, slope, gain), in_right(slope)
    guess = expected + np.random.default_rng(seed).uniform(-0.7, 0.7, (len(POINTS), 1)) * [1, 0]
    right, slopes = fit_surfaces(*images, POINTS, guess.astype(np.float32), FOCAL_LENGTH)
    assert np.median(np.abs(slopes - slope)) < 0.01
    assert np.median(np.abs(right - expected)) < 0.05
    known = np.tile(slope, (len(POINTS), 1))
    right = match_on_surfaces(*images, POINTS, guess.astype(np.float32), known)
    assert np.abs(right - expected).max() < 0.1


@pytest.mark.parametrize("slope", [np.array([0.1, 0.0]), np.array([0.0, -0.1])])
def test_disparities_of_planes_that_are_taken_to_face_the_camera_are_off(slope: Array) -> None:
    images, expected = stereo(3, slope), in_right(slope)
    facing = match_on_surfaces(*images, POINTS, expected, np.zeros((len(POINTS), 2)))
    known = match_on_surfaces(*images, POINTS, expected, np.tile(slope, (len(POINTS), 1)))
    assert np.abs(facing - expected).mean() > 5 * np.abs(known - expected).mean()


def fitted_by_numpy(images: tuple[Pyramid, Pyramid], left: Array, right: Array) -> Array:
    """Return the disparity's change and the slope (3,), by the formulas of the kernel."""
    border, half = SIDE + BEYOND, SIDE // 2
    source, target = (one.levels[0].astype(np.float64) for one in images)
    dv, du = (one.astype(np.float64) for one in np.mgrid[-half : half + 1, -half : half + 1])

    def sampled(image: Array, x: Array, y: Array) -> Array:
        return map_coordinates(image, [y + border, x + border], order=1)

    u, v = left[0] + du, left[1] + dv
    patch = sampled(source, u, v)
    scharr = ((-1, 3 / 32), (0, 10 / 32), (1, 3 / 32))
    beside = ((w, sampled(source, u + 1, v + k) - sampled(source, u - 1, v + k)) for k, w in scharr)
    across = sum(w * change for w, change in beside)
    patch -= patch.mean()
    J = np.stack([across, across * du, across * dv], axis=-1).reshape(-1, 3)
    spread, found = SLANT / FOCAL_LENGTH * (left[0] - right[0]), np.zeros(3)
    for _ in range(20):
        disparity = found[0] + found[1] * du + found[2] * dv
        seen = sampled(target, right[0] + du - disparity, right[1] + dv)
        seen -= seen.mean()
        gain = (patch * seen).sum() / (patch * patch).sum()
        error = (seen - gain * patch).ravel()
        weight = ALIKE * ((error**2).mean() + LEAST_NOISE**2) / (gain * spread) ** 2
        prior = weight * np.diag([0.0, 1.0, 1.0])
        found = found + np.linalg.solve(J.T @ J + prior, J.T @ error / gain - prior @ found)
    return found


@given(seeds, slopes_of_planes)
@settings(deadline=None, max_examples=20)
def test_the_kernel_does_what_its_formulas_say(seed: int, slope: Array) -> None:
    images, guess = stereo(seed, slope, 0.7), in_right(slope) + np.float32([0.3, 0.0])
    right, slopes = fit_surfaces(*images, POINTS, guess, FOCAL_LENGTH)
    given_points = zip(POINTS.astype(float), guess.astype(float), strict=True)
    expected = np.stack([fitted_by_numpy(images, *each) for each in given_points])
    found = np.column_stack([guess[:, 0] - right[:, 0], slopes])
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("content", ["blank", "beyond"])
def test_matches_stay_without_contrast_or_beyond_the_image(content: str) -> None:
    images = stereo(1, np.zeros(2))
    if content == "blank":
        images = (pyramid(np.full(SHAPE, 80, np.uint8)),) * 2
    left = POINTS + np.float32([1000 if content == "beyond" else 0, 0])
    right, slopes = fit_surfaces(*images, left, left - np.float32([12, 0]), FOCAL_LENGTH)
    np.testing.assert_array_equal(right, left - np.float32([12, 0]))
    assert not slopes.any()


def drift_before_a_wall(slopes: bool) -> float:
    """Move along a wall at an angle; return the tracks' median error after 0.4 m, pixels.

    The wall is n . X = 1 in the first left camera; a camera at t sees what the first one does moved
    by the homography K (1 - t n^T) K^-1, up to its scale.
    """
    camera = StereoCamera(FOCAL_LENGTH, FOCAL_LENGTH, *MIDDLE, 0.14)
    K = np.array([[FOCAL_LENGTH, 0, MIDDLE[0]], [0, FOCAL_LENGTH, MIDDLE[1]], [0, 0, 1]])
    n, image = np.array([0.35, -0.2, 0.5]), random_picture(8, SHAPE)

    def to_camera(t: Array) -> Array:
        return K @ (np.eye(3) - np.outer(t, n)) @ np.linalg.inv(K)

    config = TrackingConfig.model_validate({"klt": {"slopes": slopes, "min_row_gradient": 0}})
    tracker = KltTracker(config, camera)
    for number in range(21):
        t = 0.02 * number * RIGHT
        views = (to_camera(t + b * RIGHT) for b in (0.0, camera.baseline))
        left, right = (
            cv2.warpPerspective(image, H, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT_101)
            for H in views
        )
        tracker.T_start_cam = se3_exp([0, 0, 0, *t])
        seen = track(tracker, left, right)
        if number == 0:
            first = seen
    _, i, j = np.intersect1d(first.landmark, seen.landmark, return_indices=True)
    assert len(i) > 10
    rays = np.column_stack([first.left[i], np.ones(len(i))]) @ to_camera(t).T
    expected = rays[:, :2] / rays[:, 2:]
    return float(np.median(np.linalg.norm(seen.left[j] - expected, axis=1)))


def test_tracks_on_a_wall_at_an_angle_do_not_drift() -> None:
    assert drift_before_a_wall(slopes=True) < 0.3 * drift_before_a_wall(slopes=False)
