"""The detector equals plain correlations, and its non-maximum suppression the definition."""

from __future__ import annotations

import numpy as np
import pytest
from front_end_scenes import Texture, random_binary, window
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from gpvo.config import FeatureConfig
from gpvo.tracking.features import (
    ANY,
    DESCRIPTOR_OFFSETS,
    MARGIN,
    Crowd,
    block_maxima,
    describe,
    detect,
    extrema,
    gradients,
    half_resolution,
    smooth,
    strongest_spaced,
)
from gpvo.tracking.responses import BLOB_MASK, CORNER_MASK, blob_and_corner

seeds = st.integers(0, 2**32)


def responses(image: NDArray[np.uint8]) -> dict[int, NDArray[np.int64]]:
    """Compute responses that are large at features of each kind."""
    blob = ndimage.correlate(image.astype(np.int64), BLOB_MASK.astype(np.int64), mode="mirror")
    corner = ndimage.correlate(image.astype(np.int64), CORNER_MASK.astype(np.int64), mode="mirror")
    return {0: -blob, 1: blob, 2: -corner, 3: corner}


def images() -> list[NDArray[np.uint8]]:
    rng = np.random.default_rng(0)
    return [
        Texture(0).grey(),
        Texture(1).binary(),
        random_binary(2, 121),
        rng.integers(0, 256, (60, 95)).astype(np.uint8),
    ]


def test_masks_ignore_a_constant_image() -> None:
    assert BLOB_MASK.sum() == CORNER_MASK.sum() == 0
    assert len(detect(np.full((50, 50), 200, np.uint8), FeatureConfig())) == 0


@pytest.mark.parametrize("image", images())
def test_responses_are_those_of_the_masks_but_at_the_border(image: NDArray[np.uint8]) -> None:
    expected = responses(image)
    for found, kind in zip(blob_and_corner(image), (1, 3), strict=True):
        inner = found[2:-2, 2:-2]
        np.testing.assert_array_equal(inner, expected[kind][2:-2, 2:-2])
        assert np.abs(found.astype(np.int64)).sum() == np.abs(inner.astype(np.int64)).sum() > 0


@pytest.mark.parametrize("image", images())
@pytest.mark.parametrize("radius", [1, 3, 5])
def test_every_feature_is_an_extremum_of_its_window(image: NDArray[np.uint8], radius: int) -> None:
    points, kinds, heights = extrema(image, radius, 50.0)
    assert len(points) > 10
    counted = (1, 1, 2, 2)
    for kind, response in responses(image).items():
        last_row, last_column = np.subtract(image.shape, MARGIN + 1)
        for (u, v), height in zip(points[kinds == kind], heights[kinds == kind], strict=True):
            around = response[
                v - radius : min(v + radius, last_row) + 1,
                u - radius : min(u + radius, last_column) + 1,
            ]
            assert around.max() == response[v, u] >= 50
            assert height == counted[kind] * response[v, u]


@given(seeds, st.integers(1, 6), st.integers(0, 6), st.integers(0, 50), st.integers(0, 50))
@settings(deadline=None, max_examples=60)
def test_suppression_finds_each_strict_maximum_and_no_two_within_the_radius(
    seed: int, radius: int, margin: int, height: int, width: int
) -> None:
    response = np.random.default_rng(seed).random((height, width)).astype(np.float32)
    found = block_maxima(response, radius, 0.5, margin)
    assert len(np.unique(found, axis=0)) == len(found)
    distance = np.abs(found[:, None] - found[None]).max(axis=2)
    assert (distance[~np.eye(len(found), dtype=bool)] > radius).all()

    windows = ndimage.maximum_filter(response, size=2 * radius + 1, mode="constant", cval=-np.inf)
    is_maximum = (response == windows) & (response >= 0.5)
    low, high = radius + margin, np.array([width, height]) - radius - margin
    v, u = np.nonzero(is_maximum)
    wanted = np.column_stack([u, v])[(u >= low) & (u < high[0]) & (v >= low) & (v < high[1])]
    assert {tuple(p) for p in wanted} <= {tuple(p) for p in found}
    assert (found >= low).all() and (found < np.array([width, height]) - margin).all()


def test_equal_neighbours_are_the_only_features_within_the_radius() -> None:
    image = Texture(1).binary()
    points, kinds, heights = extrema(image, 3, 50.0)
    for kind in range(4):
        p, height = points[kinds == kind], heights[kinds == kind]
        near = np.abs(p[:, None] - p[None]).max(axis=2) <= 3
        i, j = np.nonzero(near)
        assert (height[i] == height[j]).all()


@pytest.mark.parametrize(("value", "kind"), [(255, 1), (-255, 0)])
def test_a_dot_is_a_blob(value: int, kind: int) -> None:
    image = np.full((41, 41), 255 if value < 0 else 0)
    image[19:22, 19:22] += value
    found = detect(image.astype(np.uint8), FeatureConfig(response_threshold=255 * 15))
    assert found.points.tolist() == [[20, 20]] and found.kind.tolist() == [kind]


@pytest.mark.parametrize("kind", [2, 3])
def test_crossing_squares_are_a_corner(kind: int) -> None:
    image = np.zeros((41, 41), np.uint8)
    image[:20, :20] = image[21:, 21:] = 255
    image = image[:, ::-1] if kind == 2 else image
    found = detect(image, FeatureConfig(response_threshold=255 * 7))
    corner = found[found.kind >= 2]
    assert corner.points.tolist() == [[20, 20]] and corner.kind.tolist() == [kind]
    assert corner.strength == 1


@pytest.mark.parametrize("image", images())
def test_descriptors_are_sampled_sobel_gradients(image: NDArray[np.uint8]) -> None:
    smoothing, derivative = np.array([1, 4, 6, 4, 1]), np.array([1, 2, 0, -2, -1])
    expected = np.empty((*image.shape, 2), np.uint8)
    for axis, mask in ((0, np.outer(smoothing, derivative)), (1, np.outer(derivative, smoothing))):
        gradient = ndimage.correlate(image.astype(np.int64), mask, mode="mirror")
        expected[..., axis] = np.clip(np.floor_divide(gradient, 128) + 128, 0, 255)
    np.testing.assert_array_equal(gradients(image), expected)

    found = detect(image, FeatureConfig())
    for (u, v), descriptor in zip(found.points, found.descriptors, strict=True):
        samples = [expected[v + dy, u + dx] for dx, dy in DESCRIPTOR_OFFSETS]
        np.testing.assert_array_equal(descriptor, np.concatenate(samples))


def test_descriptor_offsets_are_libviso2s() -> None:
    assert len({tuple(o) for o in DESCRIPTOR_OFFSETS}) == 16
    assert {tuple(np.abs(o)) for o in DESCRIPTOR_OFFSETS} == {(1, 1), (3, 1), (1, 5), (5, 3)}
    assert np.abs(DESCRIPTOR_OFFSETS).max() < MARGIN


@given(st.integers(-20, 20), st.integers(-20, 20))
@settings(deadline=None, max_examples=20)
def test_descriptors_move_with_the_image(dx: int, dy: int) -> None:
    texture = random_binary(3)
    points = np.random.default_rng(0).integers(40, 140, (50, 2)).astype(np.int32)
    still = describe(gradients(window(texture, 0, 0)), points)
    moved = describe(gradients(window(texture, dx, dy)), points + np.array([dx, dy], np.int32))
    np.testing.assert_array_equal(still, moved)


@pytest.mark.parametrize("shape", [(12, 13), (7, 8), (180, 240), (5, 5)])
def test_half_resolution_is_the_mean_of_four_rounded_down(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    half = half_resolution(image)
    assert half.shape == (shape[0] // 2, shape[1] // 2) and half.dtype == np.uint8
    for row in range(half.shape[0]):
        for column in range(half.shape[1]):
            block = image[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
            assert half[row, column] == int(block.astype(int).sum()) // 4


@given(
    seeds,
    st.integers(0, 60),
    st.integers(0, 10),
    st.integers(1, 12),
    st.integers(-3, 30),
    st.sampled_from([ANY, Crowd(60, 60, 5), Crowd(15, 20, 2), Crowd(20, 15, 0)]),
)
@settings(deadline=None, max_examples=80)
def test_spaced_features_are_the_greedy_choice(
    seed: int, candidates: int, taken_count: int, spacing: int, count: int, crowd: Crowd
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 60, (candidates, 2)).astype(np.int32)
    strength = rng.random(candidates).astype(np.float32)
    taken = rng.uniform(0, 59, (taken_count, 2)).astype(np.float32)

    occupied, expected = [*np.rint(taken)], []
    for i in np.argsort(-strength):
        free = all(np.abs(points[i] - other).max() >= spacing for other in occupied)
        part = points[i] // (crowd.width, crowd.height)
        alike = [(other // (crowd.width, crowd.height) == part).all() for other in occupied]
        if free and sum(alike) < crowd.most and len(expected) < count:
            occupied.append(points[i])
            expected.append(i)
    chosen = strongest_spaced(points, strength, taken, spacing, count, crowd)
    assert chosen.tolist() == expected


def test_one_feature_is_left_where_they_are_farther_apart_than_the_image_is_wide() -> None:
    points, strength = np.array([[3, 4], [90, 70]], np.int32), np.array([1.0, 2.0], np.float32)
    chosen = strongest_spaced(points, strength, np.empty((0, 2), np.float32), 10**9, 5)
    assert chosen.tolist() == [1]


@pytest.mark.parametrize("deviation", [1e-6, 0.1, 0.3])
def test_a_blur_of_less_than_a_pixel_leaves_contours_their_contrast(deviation: float) -> None:
    line = np.zeros((20, 20), np.uint8)
    line[:, 10] = 255
    np.testing.assert_allclose(smooth(line, deviation), line, atol=3)
