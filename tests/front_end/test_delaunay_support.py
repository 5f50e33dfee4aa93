"""Neighbours in the triangulation reveal outliers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.tracking.viso2.delaunay_support import are_supported


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
    kept = are_supported(points.astype(np.int32), flow, disparity, 5.0, 5.0, 4)
    assert not kept[outlier].any()
    inside = ((points > 20) & (points < 210)).all(axis=1)
    assert kept[~outlier & inside].all()
    assert are_supported(points.astype(np.int32), flow, disparity, 5.0, 5.0, 0).all()


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=20)
def test_who_asks_for_more_keeps_fewer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 200, (60, 2)).astype(np.int32)
    flow = rng.integers(-4, 5, (60, 2)).astype(np.int32)
    kept = [are_supported(points, flow, flow[:, 0], 5.0, 5.0, least) for least in range(14)]
    assert kept[0].all()
    assert all((more <= fewer).all() for fewer, more in pairwise(kept))


@pytest.mark.parametrize("count", [0, 1, 3, 30])
def test_matches_that_cannot_be_judged_are_kept(count: int) -> None:
    on_a_line = np.column_stack([np.arange(count), 2 * np.arange(count)]).astype(np.int32)
    flow = np.random.default_rng(0).integers(-99, 99, (count, 2)).astype(np.int32)
    assert are_supported(on_a_line, flow, flow[:, 0], 5.0, 5.0, 4).all()
