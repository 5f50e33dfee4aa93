"""Quad matching recovers known shifts, within its ranges, and neighbours unmask outliers."""

from __future__ import annotations

import numpy as np
import pytest
from front_end_scenes import HEIGHT, WIDTH, random_grey, window
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gpvo.config import FeatureConfig, Viso2Config
from gpvo.features import Features, detect
from gpvo.matching import (
    NO_MATCH,
    IndexedFeatures,
    StereoFeatures,
    delaunay_support,
    match_quads,
)

CONFIG = Viso2Config(flow_radius=25, max_disparity=40)
FEATURES = FeatureConfig(response_threshold=600)
TEXTURE = random_grey(0)
Shift = tuple[int, int]


def stereo_features(left: Shift, right: Shift) -> StereoFeatures:
    """Features of the texture moved by (dx, dy) in each of two images."""
    return StereoFeatures(
        *(
            IndexedFeatures(detect(window(TEXTURE, *shift), FEATURES), HEIGHT)
            for shift in (left, right)
        )
    )


def quad_points(
    quads: NDArray[np.int64], current: StereoFeatures, previous: StereoFeatures
) -> list[NDArray[np.int32]]:
    """Current left, current right, previous right and previous left points (M, 2)."""
    images = (current.left, current.right, previous.right, previous.left)
    return [i.features.points[q] for i, q in zip(images, quads.T, strict=True)]


def seen_in_all(points: NDArray[np.int32], shifts: list[Shift]) -> NDArray[np.bool_]:
    """Which points (N, 2) are well inside all images of the shifted texture."""
    moved = points + np.array(shifts)[:, None]
    return ((moved > 16) & (moved < np.array([WIDTH, HEIGHT]) - 16)).all(axis=(0, 2))


@given(st.integers(-20, 20), st.integers(-20, 20), st.integers(1, 38), st.integers(-2, 2))
@settings(deadline=None, max_examples=15)
def test_quads_recover_flow_and_disparity(dx: int, dy: int, disparity: int, closer: int) -> None:
    earlier = max(1, disparity + closer)
    current = stereo_features((dx, dy), (dx - disparity, dy))
    previous = stereo_features((0, 0), (-earlier, 0))
    quads = match_quads(current, previous, 1, CONFIG)
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
    """Share of the left features whose quad is the true one."""
    current = stereo_features((flow, 0), (flow - disparity, row_shift))
    previous = stereo_features((0, 0), (-disparity, row_shift))
    quads = match_quads(current, previous, 1, config)
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
        quads = match_quads(current, previous, frames_between, CONFIG)
        left, *_, previous_left = quad_points(quads, current, previous)
        true.append(((left - previous_left) == (40, 0)).all(axis=1).sum())
    assert true[0] == 0 and true[1] > 0.6 * len(current.left.features)


def random_features(rng: np.random.Generator, count: int) -> Features:
    return Features(
        rng.integers(0, 40, (count, 2)).astype(np.int32),
        rng.integers(0, 4, count).astype(np.int32),
        rng.integers(0, 256, (count, 32)).astype(np.uint8),
    )


@given(st.integers(0, 2**32), st.integers(0, 80))
@settings(deadline=None, max_examples=30)
def test_search_is_the_least_difference_among_the_candidates(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    queries, known = random_features(rng, 30), random_features(rng, count)
    columns, rows = (-12, 7), (-3, 5)
    selected = np.append(rng.permutation(30), NO_MATCH)
    found = IndexedFeatures(known, 40).search(queries, selected, columns, rows)
    for i, j in zip(selected[:-1], found[:-1], strict=True):
        offset = known.points - queries.points[i]
        candidate = known.kind == queries.kind[i]
        candidate &= (offset[:, 0] >= columns[0]) & (offset[:, 0] <= columns[1])
        candidate &= (offset[:, 1] >= rows[0]) & (offset[:, 1] <= rows[1])
        difference = known.descriptors.astype(int) - queries.descriptors[i]
        cost = np.where(candidate, np.abs(difference).sum(axis=1), 10**6)
        assert j == (cost.argmin() if candidate.any() else NO_MATCH)
    assert found[-1] == NO_MATCH


def test_blank_images_have_no_quads() -> None:
    blank = IndexedFeatures(detect(np.zeros((50, 50), np.uint8), FeatureConfig()), 50)
    assert match_quads(*[StereoFeatures(blank, blank)] * 2, 1, CONFIG).shape == (0, 4)


@given(st.integers(0, 2**32), st.sampled_from(["flow", "disparity"]))
@settings(deadline=None, max_examples=30)
def test_support_throws_out_planted_outliers(seed: int, which: str) -> None:
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[10:230:14, 10:230:14]
    points = np.column_stack([u.ravel(), v.ravel()]) + rng.integers(-2, 3, (u.size, 2))
    flow = (points @ [[0.03, 0.02], [-0.02, 0.04]]).astype(np.int32)
    disparity = (20 + points @ [0.04, -0.03]).astype(np.int32)
    # One outlier in each block of 4 x 4 points, so that its neighbours have enough good ones.
    outlier = (v.ravel() // 14 % 4 == 1) & (u.ravel() // 14 % 4 == 1)
    if which == "flow":
        flow[outlier] += rng.choice([-12, 12], (outlier.sum(), 2)).astype(np.int32)
    else:
        disparity[outlier] += rng.choice([-12, 12], outlier.sum()).astype(np.int32)
    kept = delaunay_support(points.astype(np.int32), flow, disparity, 5.0, 5.0)
    assert not kept[outlier].any()
    inside = ((points > 20) & (points < 210)).all(axis=1)
    assert kept[~outlier & inside].all()


@pytest.mark.parametrize("count", [0, 1, 3, 30])
def test_matches_that_cannot_be_judged_are_kept(count: int) -> None:
    on_a_line = np.column_stack([np.arange(count), 2 * np.arange(count)]).astype(np.int32)
    flow = np.random.default_rng(0).integers(-99, 99, (count, 2)).astype(np.int32)
    assert delaunay_support(on_a_line, flow, flow[:, 0], 5.0, 5.0).all()
