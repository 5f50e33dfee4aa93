"""How far matches are off follows from the gradients of their patches."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gpvo.tracking.klt.lucas_kanade import Pyramid, match_patches
from gpvo.tracking.klt.match_precision import (
    LARGEST,
    SHARE,
    MatchPrecision,
    compare_patches_kernel,
    match_variances,
)

Points = NDArray[np.float32]

SIDE, NOISE = 31, 6.0
POINTS = np.stack(np.meshgrid(np.arange(40, 290, 25), np.arange(40, 200, 25)), 2).reshape(-1, 2)
POINTS = POINTS.astype(np.float32)  # between pixels, interpolation would lessen the noise


def texture() -> NDArray[np.float64]:
    """Make an image whose contrast grows to the right, finer along the rows at the bottom."""
    rng, height, width = np.random.default_rng(0), 240, 330
    fine, coarse = (
        cv2.GaussianBlur(rng.normal(0, 1, (height, width)), (0, 0), sigmaX=s, sigmaY=2.5)
        for s in (1.5, 6.0)
    )
    down = np.linspace(0, 1, height)[:, None]
    image = down * fine / fine.std() + (1 - down) * coarse / coarse.std()
    return np.asarray(127 + np.linspace(8, 30, width) * image)


def pyramid(image: NDArray[np.float64]) -> Pyramid:
    return Pyramid.of_image(np.clip(np.rint(image), 0, 255).astype(np.uint8), SIDE, 0)


def match_deviations(left: Pyramid, right: Pyramid, points: Points) -> NDArray[np.float64]:
    """Compute the deviations (N, 3) of points that do not move, which are all of the frame."""
    variances = match_variances(left, right, points, points)
    return MatchPrecision().deviations(variances, variances[:0])


def test_noise_moves_matches_by_the_inverse_of_the_gradients_squares() -> None:
    image, rng = texture(), np.random.default_rng(1)
    source, errors = pyramid(image), []
    for _ in range(60):
        target = pyramid(image + NOISE * rng.normal(size=image.shape))
        ends, found = match_patches(source, target, POINTS, POINTS, 0)
        assert found.all()
        errors.append(ends - POINTS)
    squares, alike = np.zeros((len(POINTS), 3)), np.zeros(len(POINTS))
    images = source.levels[0], source.levels[0]
    compare_patches_kernel(*images, SIDE, POINTS, POINTS, squares, alike)
    np.testing.assert_allclose(alike, 1, atol=1e-6)
    matrices = squares[:, [[0, 1], [1, 2]]]
    found_in_units = np.einsum("rni,nij,rnj->n", errors, matrices, errors) / 60
    # Two degrees of freedom, each with the variance of the noise.
    np.testing.assert_allclose(found_in_units.mean(), 2 * NOISE**2, rtol=0.1)
    assert found_in_units.min() > 0.4 * 2 * NOISE**2
    assert found_in_units.max() < 2.0 * 2 * NOISE**2


def test_matches_of_weak_or_noisy_patches_count_less() -> None:
    image, rng = texture(), np.random.default_rng(2)
    noisy = image + NOISE * rng.normal(size=image.shape)
    left, right = pyramid(image), pyramid(noisy)
    deviations = match_deviations(left, right, POINTS)
    thirds = [
        deviations[(POINTS[:, 0] > low) & (POINTS[:, 0] <= low + 84)] for low in (39, 123, 207)
    ]
    for weak, strong in pairwise(thirds):
        assert (np.median(weak, axis=0) > 1.05 * np.median(strong, axis=0)).all()
    coarse, fine = (deviations[rows, 2] for rows in (POINTS[:, 1] < 80, POINTS[:, 1] > 150))
    assert np.median(coarse) > 1.5 * np.median(fine)
    noisy[:, :165] += 2 * NOISE * rng.normal(size=(240, 165))
    worse = match_deviations(left, pyramid(noisy), POINTS)
    half = POINTS[:, 0] < 150
    gain = np.log(worse) - np.log(deviations)
    assert (np.median(gain[half], axis=0) > np.median(gain[~half], axis=0) + 0.1).all()


def test_equal_patches_count_alike_and_none_is_beyond_the_bounds() -> None:
    tile = np.tile(texture()[100:140, 100:140], (6, 8))
    points = np.float32([[100, 100], [140, 100], [100, 140], [180, 140]])
    same = pyramid(tile)
    np.testing.assert_allclose(match_deviations(same, same, points), 1.0, atol=1e-6)
    flat = pyramid(np.where(np.arange(320) < 160, 127.0, tile))
    some = np.float32([[60, 100], [240, 100], [280, 100], [240, 140]])
    deviations = match_deviations(flat, flat, some)
    assert deviations.max() <= LARGEST and deviations.min() >= 1 / LARGEST
    assert match_deviations(same, same, points[:0]).shape == (0, 3)


def frames_of(variance: float, number: int, seed: int) -> list[NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    return [variance * rng.uniform(0.9, 1.1, (25, 3)) for _ in range(number)]


@given(st.floats(1e-6, 1e6), st.floats(0.2, 8.0))
def test_a_frame_of_worse_matches_counts_less(variance: float, worse: float) -> None:
    """Only ratios to the typical match count, and the typical one is that of many frames."""
    precision = MatchPrecision()
    for frame in frames_of(variance, 8, 1):
        usual = precision.deviations(frame[:20], frame[20:])
        assert np.abs(np.log(usual)).max() < 0.1
    found = precision.deviations(*frames_of(worse * variance, 1, 2), np.empty((0, 3)))
    expected = np.sqrt(SHARE * worse + 1 - SHARE)
    np.testing.assert_allclose(np.median(found, axis=0), expected, rtol=0.05)


def test_what_is_typical_follows_what_is_seen_for_long() -> None:
    precision = MatchPrecision()
    for variance in (1.0, 4.0):
        for frame in frames_of(variance, 300, 3):
            deviations = precision.deviations(frame, frame[:0])
        np.testing.assert_allclose(np.median(deviations, axis=0), 1.0, rtol=0.05)
