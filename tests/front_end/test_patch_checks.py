"""Correlation and gradient of patches compared with their definitions, and the checks by them."""

from __future__ import annotations

import numpy as np
import pytest
from front_end_scenes import CAMERA, MovingPlane, Texture, random_grey, track
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gpvo.config import TrackingConfig
from gpvo.config.stages import KltConfig
from gpvo.tracking import Observations
from gpvo.tracking.features import smooth
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.klt.patch_checks import patch_correlation, row_gradient

RADIUS = 4
FIRST, SECOND = (random_grey(seed, 60) for seed in (1, 2))
PLANE = MovingPlane(Texture(7), np.array([0, 0, 0, 0.03, -0.02, 0]))


def random_points(seed: int, count: int = 10) -> NDArray[np.float32]:
    """Draw points (N, 2), some of them beyond the border of the images."""
    return np.random.default_rng(seed).uniform(-3, 63, (count, 2)).astype(np.float32)


def sampled(image: NDArray, points: NDArray) -> NDArray[np.float64]:
    """Sample bilinear patches (N, 81), with the border repeated."""
    dy, dx = np.mgrid[-RADIUS : RADIUS + 1, -RADIUS : RADIUS + 1]
    u, v = (points[:, axis, None] + d.ravel() for axis, d in ((0, dx), (1, dy)))
    return map_coordinates(image.astype(np.float64), [v, u], order=1, mode="nearest")


def correlations(
    first: NDArray, a: NDArray, second: NDArray, b: NDArray, radius: int = RADIUS
) -> NDArray[np.float64]:
    """Compute the correlations (N,) of patches around points (N, 2)."""
    pairs = zip(a, b, strict=True)
    return np.array([patch_correlation(first, x, second, y, radius) for x, y in pairs])


def gradients(image: NDArray, points: NDArray, radius: int = RADIUS) -> NDArray[np.float64]:
    """Compute the gradients (N,) along the row of patches around points (N, 2)."""
    return np.array([row_gradient(image, point, radius) for point in points])


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=20)
def test_correlation_is_that_of_bilinear_samples(seed: int) -> None:
    a, b = random_points(seed), random_points(seed + 1)
    found = correlations(FIRST, a, SECOND, b)
    for x, y, correlation in zip(sampled(FIRST, a), sampled(SECOND, b), found, strict=True):
        assert correlation == pytest.approx(np.corrcoef(x, y)[0, 1], abs=1e-6)


@given(st.integers(0, 2**32), st.integers(1, 4), st.integers(0, 50))
@settings(deadline=None, max_examples=20)
def test_brightness_and_contrast_do_not_matter_to_correlation(
    seed: int, gain: int, offset: int
) -> None:
    a, b, dim = random_points(seed), random_points(seed + 1), FIRST // 6
    np.testing.assert_allclose(
        correlations(dim * gain + offset, a, SECOND, b),
        correlations(dim, a, SECOND, b),
        atol=1e-9,
    )


def test_correlation_is_one_with_itself_minus_one_with_the_negative_none_with_a_blank() -> None:
    points, blank = random_points(0), np.full_like(FIRST, 80)
    same = correlations(FIRST, points, FIRST, points)
    negative = correlations(FIRST, points, 255 - FIRST, points)
    np.testing.assert_allclose([same, -negative], 1, atol=1e-9)
    assert not correlations(FIRST, points, blank, points).any()


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=20)
def test_row_gradient_is_the_central_difference(seed: int) -> None:
    points, border = random_points(seed), 10
    wide = np.pad(FIRST.astype(np.float64), border, mode="edge")
    difference = (np.roll(wide, -1, axis=1) - np.roll(wide, 1, axis=1)) / 2
    mean_square = sampled(difference**2, np.rint(points) + border).mean(axis=1)
    np.testing.assert_allclose(gradients(FIRST, points), np.sqrt(mean_square), rtol=1e-4)


@pytest.mark.parametrize("slope", [0, 1, 3])
def test_row_gradient_is_the_slope_along_the_row(slope: int) -> None:
    v, u = np.mgrid[0:60, 0:80]
    ramp = (slope * u + 255 * (v % 2) * (slope == 0)).astype(np.uint8)
    points = np.random.default_rng(0).uniform(6, 53, (20, 2)).astype(np.float32)
    np.testing.assert_allclose(gradients(ramp, points), slope, atol=1e-6)


def tracked(**fields: float) -> Observations:
    config = KltConfig.model_validate({"max_features": 500, **fields})
    tracker = KltTracker(TrackingConfig(klt=config), CAMERA)
    return Observations.concatenate([track(tracker, *PLANE.images(k)) for k in range(2)])


@pytest.mark.parametrize("check", ["min_correlation", "min_row_gradient"])
def test_no_match_is_below_what_is_asked(check: str) -> None:
    """Without a check some matches of the plane are below its limit, with it none is."""
    none = {"min_correlation": -1.0, "min_row_gradient": 0.0}
    radius, least = KltConfig().side // 4, []
    for limit in (none[check], {"min_correlation": 0.9, "min_row_gradient": 40.0}[check]):
        seen, scores = tracked(**{**none, check: limit}), []
        for frame in range(2):
            left, right = (smooth(image, KltConfig().smoothing) for image in PLANE.images(frame))
            now = seen.frame == frame
            a, b = (side[now].astype(np.float32) for side in (seen.left, seen.right))
            if check == "min_correlation":
                scores.append(correlations(left, a, right, b, radius))
            else:
                scores.append(gradients(left, a, radius))
        assert len(seen) > 50
        least.append(np.concatenate(scores).min())
    assert least[0] < limit <= least[1]
