"""Among noise a quad may end farther from its start: matches scatter more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from front_end_scenes import CAMERA, Image, MovingPlane, Texture, cluster_of, track
from numpy.typing import NDArray

from gpvo.config import TrackingConfig
from gpvo.tracking.klt import KltTracker

PLANE = MovingPlane(Texture(7), np.array([0, 0, 0, 0.03, -0.02, 0]))


def noisy(image: Image, noise: float, rng: np.random.Generator) -> Image:
    """Show noise at a share of the pixels of a picture of contours."""
    return np.where(rng.random(image.shape) < noise, 255, image).astype(np.uint8)


def errors(noise: float, noise_share: float) -> NDArray[np.float64]:
    """Return how far from its point the landmarks are that are followed for two frames, pixels."""
    tracker, rng = KltTracker(TrackingConfig(), CAMERA), np.random.default_rng(3)
    tracker.stereo.noise_share = noise_share
    pairs = [[noisy(one, noise, rng) for one in PLANE.images(frame)] for frame in range(3)]
    first, *_, last = (track(tracker, *pair) for pair in pairs)
    first, last = first[first.frame == 0], last[last.frame == 2]
    _, i, j = np.intersect1d(first.landmark, last.landmark, return_indices=True)
    expected = PLANE.project(2, PLANE.plane_points(0, first.left[i]))[:, :2]
    return np.linalg.norm(last.left[j] - expected, axis=1)


def test_among_noise_that_is_known_more_landmarks_are_followed_and_none_is_wrong() -> None:
    strict, tolerant = errors(0.3, 0.0), errors(0.3, 0.5)
    assert len(tolerant) > 1.1 * len(strict)
    assert tolerant.max() < 2 and np.median(tolerant) < 0.3


def test_clean_pictures_are_followed_alike() -> None:
    np.testing.assert_array_equal(errors(0.0, 0.0), errors(0.0, 0.5))


@pytest.mark.parametrize("left", [0.0, 30.0])
def test_the_share_of_noise_is_that_of_both_cameras(left: float) -> None:
    image = np.zeros((180, 240), np.uint8)
    image[:, :1] = 255
    clean = cluster_of(image, image)
    noise = {"left": left, "right": 60.0}
    sides = {name: replace(getattr(clean, name), noise_count=n) for name, n in noise.items()}
    assert clean.noise_share == 0.0
    assert replace(clean, **sides).noise_share == pytest.approx((left + 60) / 360)
