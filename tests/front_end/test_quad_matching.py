"""Quad matching recovers known shifts, within its ranges, in one stage and in two."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from front_end_scenes import HEIGHT, WIDTH, random_grey, window
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gpvo.config import FeatureConfig, Viso2Config
from gpvo.tracking.features import Features, detect
from gpvo.tracking.viso2.quad_matching import (
    NO_MATCH,
    StereoFeatures,
    index_features,
    match_quads,
    quad_points,
)
from gpvo.tracking.viso2.search_ranges import SearchRanges, everywhere, near_matches

CONFIG = Viso2Config(flow_radius=25, max_disparity=40)
FEATURES = FeatureConfig(response_threshold=600)
TEXTURE = random_grey(0)
Shift = tuple[int, int]


def stereo_features(left: Shift, right: Shift, nms_radius: int = 3) -> StereoFeatures:
    """Detect features of the texture moved by (dx, dy) in each of two images."""
    config = FEATURES.model_copy(update={"nms_radius": nms_radius})
    return StereoFeatures(
        *(
            index_features(detect(window(TEXTURE, *shift), config), HEIGHT)
            for shift in (left, right)
        )
    )


def ranges(config: Viso2Config, frames_between: int = 1) -> SearchRanges:
    return everywhere((HEIGHT, WIDTH), frames_between, config)


def seen_in_all(points: NDArray[np.int32], shifts: list[Shift]) -> NDArray[np.bool_]:
    """Return which points (N, 2) are well inside all images of the shifted texture."""
    moved = points + np.array(shifts)[:, None]
    return ((moved > 16) & (moved < np.array([WIDTH, HEIGHT]) - 16)).all(axis=(0, 2))


@given(st.integers(-20, 20), st.integers(-20, 20), st.integers(1, 38), st.integers(-2, 2))
@settings(deadline=None, max_examples=15)
def test_quads_recover_flow_and_disparity(dx: int, dy: int, disparity: int, closer: int) -> None:
    earlier = max(1, disparity + closer)
    current = stereo_features((dx, dy), (dx - disparity, dy))
    previous = stereo_features((0, 0), (-earlier, 0))
    quads = match_quads(current, previous, ranges(CONFIG), CONFIG)
    left, right, previous_right, previous_left = quad_points(quads, current, previous)

    right_shift, right_back, back = (-disparity, 0), (-dx - earlier, -dy), (-dx, -dy)
    true = (right - left == right_shift).all(axis=1)
    true &= (previous_right - left == right_back).all(axis=1)
    true &= (previous_left - left == back).all(axis=1)
    shifts = [(0, 0), right_shift, right_back, back]
    assert true[seen_in_all(left, shifts)].all() and true.mean() > 0.98
    assert true.sum() >= 0.97 * seen_in_all(current.left.features.points, shifts).sum()
    assert len(np.unique(quads[:, 0])) == len(quads)


def found_share(disparity: int, row_shift: int, flow: int, config: Viso2Config) -> float:
    """Compute the share of the left features whose quad is the true one."""
    current = stereo_features((flow, 0), (flow - disparity, row_shift))
    previous = stereo_features((0, 0), (-disparity, row_shift))
    quads = match_quads(current, previous, ranges(config), config)
    left, right, _, previous_left = quad_points(quads, current, previous)
    true = (left - right == (disparity, -row_shift)).all(axis=1)
    true &= (left - previous_left == (flow, 0)).all(axis=1)
    return float(true.sum() / len(current.left.features))


@pytest.mark.parametrize(
    ("disparity", "row_shift", "flow", "is_found"),
    [
        (20, 0, 10, True),
        (20, 1, 10, True),
        (20, -1, 10, True),
        (20, 2, 10, False),
        (20, -2, 10, False),
        (1, 0, 10, True),
        (0, 0, 10, False),
        (-20, 0, 10, False),
        (40, 0, 10, True),
        (41, 0, 10, False),
        (20, 0, 25, True),
        (20, 0, 26, False),
        (20, 0, -25, True),
        (20, 0, -26, False),
    ],
)
def test_matches_lie_within_rows_disparities_and_flow(
    disparity: int, row_shift: int, flow: int, is_found: bool
) -> None:
    share = found_share(disparity, row_shift, flow, CONFIG)
    assert (share > 0.6) if is_found else (share == 0)


def test_flow_range_grows_with_the_frames_between() -> None:
    current, previous = stereo_features((40, 0), (20, 0)), stereo_features((0, 0), (-20, 0))
    true = []
    for frames_between in (1, 2):
        quads = match_quads(current, previous, ranges(CONFIG, frames_between), CONFIG)
        left, *_, previous_left = quad_points(quads, current, previous)
        true.append(((left - previous_left) == (40, 0)).all(axis=1).sum())
    assert true[0] == 0 and true[1] > 0.6 * len(current.left.features)


def random_features(rng: np.random.Generator, count: int) -> Features:
    return Features(
        rng.integers(0, 40, (count, 2)).astype(np.int32),
        rng.integers(0, 4, count).astype(np.int32),
        rng.random(count).astype(np.float32),
        rng.integers(0, 256, (count, 32)).astype(np.uint8),
    )


@given(st.integers(0, 2**32), st.integers(0, 80))
@settings(deadline=None, max_examples=30)
def test_search_is_the_least_difference_among_the_candidates(seed: int, count: int) -> None:
    """Windows may lie partly or wholly outside the image."""
    rng = np.random.default_rng(seed)
    queries, indexed = random_features(rng, 30), index_features(random_features(rng, count), 40)
    known, selected = indexed.features, np.append(rng.permutation(30), NO_MATCH)
    lowest, width = rng.uniform(-80, 60, (31, 2)), rng.uniform(0, 40, (31, 2))
    windows = np.stack([lowest, lowest + width], axis=2).reshape(31, 4)
    found = indexed.search(queries, selected, windows)
    for i, j, (left, right, top, bottom) in zip(selected[:-1], found, windows, strict=False):
        offset = known.points - queries.points[i]
        candidate = known.kind == queries.kind[i]
        candidate &= (offset[:, 0] >= left) & (offset[:, 0] <= right)
        candidate &= (offset[:, 1] >= top) & (offset[:, 1] <= bottom)
        difference = known.descriptors.astype(int) - queries.descriptors[i]
        cost = np.where(candidate, np.abs(difference).sum(axis=1), 10**6)
        assert j == (cost.argmin() if candidate.any() else NO_MATCH)
    assert found[-1] == NO_MATCH


@given(st.integers(0, 2**32), st.integers(0, 80))
@settings(deadline=None, max_examples=20)
def test_the_index_keeps_every_feature(seed: int, count: int) -> None:
    features = random_features(np.random.default_rng(seed), count)
    indexed = index_features(features, 40)
    ordered, start = indexed.features, indexed.start
    for key, (first, last) in enumerate(pairwise(start)):
        assert (ordered.kind[first:last] == key // 40).all()
        assert (ordered.points[first:last, 1] == key % 40).all()
    assert start[0] == 0 and start[-1] == len(ordered) == count
    for name in ("points", "kind", "strength", "descriptors"):
        rows = (np.column_stack([f.strength, getattr(f, name)]) for f in (features, ordered))
        before, after = (r[np.argsort(r[:, 0])] for r in rows)
        np.testing.assert_array_equal(before, after)


def test_blank_images_have_no_quads() -> None:
    blank = index_features(detect(np.zeros((50, 50), np.uint8), FeatureConfig()), 50)
    pair = StereoFeatures(blank, blank)
    assert match_quads(pair, pair, ranges(CONFIG), CONFIG).shape == (0, 4)


@given(st.integers(-24, 24), st.integers(-24, 24), st.integers(1, 38))
@settings(deadline=None, max_examples=10)
def test_two_stages_keep_every_true_quad_of_one_and_search_less(
    dx: int, dy: int, disparity: int
) -> None:
    """The best of all candidates is also the best of fewer, if it is one of them."""
    config = CONFIG.model_copy(update={"min_support": 0})
    shifts = [(dx, dy), (dx - disparity, dy)], [(0, 0), (-disparity, 0)]
    current, previous = (stereo_features(*shift) for shift in shifts)
    sparse = [stereo_features(*shift, nms_radius=9) for shift in shifts]
    whole = ranges(CONFIG)
    first = match_quads(sparse[0], sparse[1], whole, CONFIG)
    near = near_matches(quad_points(first, sparse[0], sparse[1]), whole, 10.0)
    one, two = (match_quads(current, previous, r, config) for r in (whole, near))

    left, right, _, previous_left = quad_points(one, current, previous)
    true = (left - right == (disparity, 0)).all(axis=1)
    true &= (left - previous_left == (dx, dy)).all(axis=1)
    assert true.sum() > 100
    assert {tuple(q) for q in one[true]} <= {tuple(q) for q in two}

    area_whole, area_near = (
        ((w[..., 1] - w[..., 0]) * (w[..., 3] - w[..., 2])).mean()
        for w in (searched.at(left[true]) for searched in (whole, near))
    )
    assert area_near < 0.5 * area_whole
