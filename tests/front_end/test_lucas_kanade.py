"""Lucas-Kanade compared with its formula in plain numpy, with OpenCV, and with known motion."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from front_end_scenes import MovingPlane, Texture
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import correlate, map_coordinates

from gpvo.tracking.features import smooth
from gpvo.tracking.klt.lucas_kanade import Pyramid, match_patches

SIDE = 15
PLANE = MovingPlane(Texture(7), np.array([0, 0, 0, 0.03, -0.02, 0]))
FIRST, SECOND = (smooth(PLANE.images(frame)[0], 0.7) for frame in range(2))
SCHARR = np.outer([3, 10, 3], [-1, 0, 1]) / 32
Array = NDArray[np.float64]


def random_points(seed: int, count: int, margin: float = 0.0) -> NDArray[np.float32]:
    size = np.array(FIRST.shape[::-1]) - margin
    return np.random.default_rng(seed).uniform(margin, size, (count, 2)).astype(np.float32)


def sampled(image: Array, point: Array) -> Array:
    """Sample the patch around a point bilinearly, row by row."""
    v, u = np.mgrid[:SIDE, :SIDE] - SIDE // 2
    return map_coordinates(image, [(point[1] + v).ravel(), (point[0] + u).ravel()], order=1)


def stepped(source: Array, target: Array, point: Array, end: Array) -> Array:
    """Move the end of a point by Gauss-Newton steps for the difference of the patches."""
    gradients = (correlate(source, SCHARR), correlate(source, SCHARR.T))
    J = np.column_stack([sampled(gradient, point) for gradient in gradients])
    for _ in range(30):
        step = np.linalg.lstsq(J, sampled(source, point) - sampled(target, end), rcond=None)[0]
        end = end + step
        if np.linalg.norm(step) <= 0.01:
            break
    return end


def match(a: NDArray, b: NDArray, points: NDArray, coarser: int, side: int = SIDE) -> tuple:
    pyramids = (Pyramid.of_image(image, side, coarser) for image in (a, b))
    return match_patches(*pyramids, points, points, coarser)


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=10)
def test_one_level_is_the_formula(seed: int) -> None:
    points = random_points(seed, 10, margin=30.0)
    ends, found = match(FIRST, SECOND, points, 0)
    wide = FIRST.astype(np.float64), SECOND.astype(np.float64)
    agree = []
    for point, end in zip(points[found].astype(float), ends[found], strict=True):
        expected = stepped(*wide, point, point)
        agree.append(np.linalg.norm(end - expected) < 1e-3)
    # Where steps go back and forth for ever the kernel stops half way, the formula does not.
    assert np.mean(agree) >= 0.8


@pytest.mark.parametrize(("side", "coarser"), [(21, 2), (31, 1), (31, 3)])
def test_matches_are_opencvs(side: int, coarser: int) -> None:
    points = random_points(0, 400)
    ends, found = match(FIRST, SECOND, points, coarser, side)
    expected, status, _ = cv2.calcOpticalFlowPyrLK(
        FIRST, SECOND, points[:, None], None, winSize=(side, side), maxLevel=coarser
    )
    same = found == (status.ravel() > 0)
    apart = np.linalg.norm(ends - expected[:, 0], axis=1)[same & found]
    assert same.mean() >= 0.98 and found.mean() > 0.5
    assert np.median(apart) < 1e-3 and np.mean(apart < 0.02) > 0.95


@given(st.tuples(st.integers(-12, 12), st.integers(-12, 12)).filter(lambda d: np.hypot(*d) <= 12))
@settings(deadline=None, max_examples=10)
def test_a_moved_image_is_found_again(motion: tuple[int, int]) -> None:
    """Up to 3 pixels at the coarsest level: its waves are 3 pixels long or more, and repeat."""
    dx, dy = motion
    points = random_points(1, 50, margin=40.0)
    ends, found = match(FIRST, np.roll(FIRST, (dy, dx), (0, 1)), points, 3, 31)
    apart = np.linalg.norm(ends - points - [dx, dy], axis=1)
    assert np.mean(found & (apart < 0.05)) > 0.9


def test_nothing_is_found_without_texture_across_an_edge_or_outside() -> None:
    blank, edge = np.full_like(FIRST, 90), np.full_like(FIRST, 90)
    edge[:, 100:] = 200
    points = np.array([[100.0, 90.0]], np.float32)
    for image in (blank, edge):
        assert not match(image, image, points, 1)[1].any()
    far = np.array([[-SIDE, 50.0], [50.0, FIRST.shape[0] + SIDE]], np.float32)
    assert not match(FIRST, FIRST, far, 1)[1].any()


@pytest.mark.parametrize("shape", [(31, 40), (62, 80), (63, 80), (240, 320)])
def test_levels_are_larger_than_a_patch(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    levels, _ = cv2.buildOpticalFlowPyramid(image, (31, 31), 3, withDerivatives=False)
    pyramid = Pyramid.of_image(image, 31, 3)
    assert pyramid.coarsest == levels and len(pyramid.levels) == 4
    assert all(level is pyramid.levels[levels] for level in pyramid.levels[levels:])
