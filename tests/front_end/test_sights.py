"""What the motion does to landmarks and to the image around them."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from factors import StereoCamera
from factors.lie import se3_exp
from gpvo.tracking.ego_motion import camera_of_pixels
from gpvo.tracking.sights import (
    LARGEST,
    LARGEST_SLOPE,
    UPRIGHT,
    Sights,
    predict,
    slopes,
    warp,
)

CAMERA = StereoCamera(200.0, 210.0, 160.0, 120.0, 0.1)
seeds = st.integers(0, 2**32)


@given(seeds, st.sampled_from([1, 2]))
@example(seed=392803, side=2)  # one landmark is almost reached
@settings(deadline=None, max_examples=50)
def test_a_warp_is_the_homography_of_the_surface(seed: int, side: int) -> None:
    rng, camera = np.random.default_rng(seed), camera_of_pixels(CAMERA, side)
    T = se3_exp(rng.normal(0, [0.1, 0.1, 0.5, 0.1, 0.1, 0.1], (5, 6)))
    pixels, disparity = rng.uniform([20, 20], [140, 100], (5, 2)), rng.uniform(8, 20, 5)
    slope = rng.normal(0, 0.1, (5, 2))

    def located(moved: np.ndarray) -> np.ndarray:
        """Move points on the planes through the landmarks."""
        there = disparity + (slope * moved).sum(axis=1)
        points = camera.triangulate(np.column_stack([pixels + moved, there]))
        return np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]

    def seen(moved: np.ndarray) -> np.ndarray:
        return camera.project(located(moved))[:, :2]

    step = 1e-5
    numerical = np.stack(
        [(seen(step * axis) - seen(-step * axis)) / (2 * step) for axis in np.eye(2)], axis=2
    )
    area, ahead = np.linalg.det(numerical), located(np.zeros(2))[:, 2] > 0
    may_be = (area > LARGEST**-2) & (area < LARGEST**2) & ahead
    warps = warp(camera, np.eye(4), Sights(pixels, disparity, T, slope))
    np.testing.assert_allclose(warps[may_be, :2], numerical[may_be], atol=1e-6)
    assert (warps[~may_be] == UPRIGHT).all()
    away = rng.uniform(-12, 12, pixels.shape)  # pixels, as far as a patch reaches
    shift = np.einsum("nij,nj->ni", warps[:, :2], away)
    expected = shift / (1 + (warps[:, 2] * away).sum(axis=1, keepdims=True))
    moved = seen(away) - seen(np.zeros(2))
    np.testing.assert_allclose(moved[may_be], expected[may_be], atol=1e-6)


@given(seeds)
@settings(deadline=None, max_examples=50)
def test_slopes_are_those_of_the_same_planes_seen_from_elsewhere(seed: int) -> None:
    rng = np.random.default_rng(seed)
    then, now = se3_exp(rng.normal(0, 0.1, (5, 6))), se3_exp(rng.normal(0, 0.1, 6))
    pixels, disparity = rng.uniform([20, 20], [300, 200], (5, 2)), rng.uniform(8, 20, 5)
    slope, step = rng.normal(0, 0.05, (5, 2)), 1e-4

    def seen(moved: np.ndarray) -> np.ndarray:
        there = disparity + (slope * moved).sum(axis=1)
        return predict(CAMERA, now, Sights(pixels + moved, there, then, slope))

    change = np.stack([seen(step * axis) - seen(-step * axis) for axis in np.eye(2)], axis=2)
    expected = np.linalg.solve(change[:, :2].transpose(0, 2, 1), change[:, 2, :, None])[..., 0]
    expected = np.clip(expected, -LARGEST_SLOPE, LARGEST_SLOPE)
    found = slopes(CAMERA, now, Sights(pixels, disparity, then, slope))
    np.testing.assert_allclose(found, expected, atol=1e-6)


@given(seeds)
@settings(deadline=None, max_examples=50)
def test_only_the_motion_since_then_matters(seed: int) -> None:
    """Prediction, warp and slope are the same in another frame of the world."""
    rng = np.random.default_rng(seed)
    pixels, disparity = rng.uniform([20, 20], [300, 200], (5, 2)), rng.uniform(8, 20, 5)
    then, now, world = (se3_exp(rng.normal(0, 0.2, (count, 6))) for count in (5, 1, 1))
    slope = rng.normal(0, 0.03, (5, 2))
    here = Sights(pixels, disparity, then, slope)
    there = Sights(pixels, disparity, world[0] @ then, slope)
    for compute in (predict, warp, slopes):
        expected = compute(CAMERA, now[0], here)
        np.testing.assert_allclose(compute(CAMERA, world[0] @ now[0], there), expected, rtol=1e-9)


def test_landmarks_are_predicted_where_they_are_seen() -> None:
    points = np.array([[0.1, 0.2, 2.0], [-0.3, 0.1, 4.0], [0.0, 0.0, -1.0]])
    then, now = se3_exp([0, 0, 0.3, 0.1, 0.0, -2.0]), se3_exp([0.1, -0.1, 0, 0.0, 0.2, 0.1])

    def seen(T: np.ndarray) -> np.ndarray:
        return CAMERA.project(points @ T[:3, :3] + np.linalg.inv(T)[:3, 3])

    measured = seen(then)
    sights = Sights(measured[:, :2], measured[:, 2], np.tile(then, (3, 1, 1)), np.zeros((3, 2)))
    predicted = predict(CAMERA, now, sights)
    np.testing.assert_allclose(predicted[:2], seen(now)[:2])
    assert np.isnan(predicted[2]).all()


def test_what_cannot_be_warped_is_left_as_it_is() -> None:
    """The landmark, 2 m ahead, is passed, almost reached, and left far behind."""
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 2, 3] = -3.0, -1.999, 2.0 * LARGEST
    facing = np.zeros((3, 2))
    sights = Sights(np.full((3, 2), 100.0), np.full(3, 200.0 * 0.1 / 2.0), T, facing)
    warps = warp(CAMERA, np.eye(4), sights)
    np.testing.assert_array_equal(warps, np.tile(UPRIGHT, (3, 1, 1)))
