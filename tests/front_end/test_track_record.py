"""Landmarks that were outliers more often than inliers propose no velocity."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from test_mc_ransac import CAMERA, INFORMATION, SHORT, random_segments, random_velocity

from gpvo.config import McRansacConfig
from gpvo.mc_ransac import Segments, TrackRecord, mc_ransac
from gpvo.mc_ransac.track_record import MOST, REMEMBERED

LANDMARKS = np.arange(10)
SCENE = LANDMARKS >= 4
"""What moves by itself are the first four."""


def judged(*verdicts: NDArray[np.bool_]) -> TrackRecord:
    record = TrackRecord()
    for inliers in verdicts:
        record.judge(LANDMARKS, inliers)
    return record


def test_who_was_never_judged_is_trusted() -> None:
    assert TrackRecord().trusted(LANDMARKS).all()
    assert TrackRecord().trusted(LANDMARKS[:0]).shape == (0,)
    assert judged(SCENE).trusted(np.array([3, 4, 10])).tolist() == [False, True, True]


@given(st.lists(st.lists(st.booleans(), min_size=10, max_size=10), max_size=8))
@settings(deadline=None)
def test_trust_is_the_balance_of_the_judgements(verdicts: list[list[bool]]) -> None:
    balance = Counter[int]()
    for verdict in verdicts:
        for landmark, inlier in enumerate(verdict):
            step = 1 if inlier else -1
            balance[landmark] = int(np.clip(balance[landmark] + step, -MOST, MOST))
    expected = np.array([balance[landmark] >= 0 for landmark in LANDMARKS])
    trusted = judged(*map(np.array, verdicts)).trusted(LANDMARKS)
    assert trusted.all() if expected.sum() <= 5 else (trusted == expected).all()


@pytest.mark.parametrize("mistakes", [1, 10, 1000])
def test_any_mistake_is_forgotten_after_as_many_judgements(mistakes: int) -> None:
    record = judged(*[SCENE] * mistakes, *[~SCENE] * MOST)
    few = np.array([0, 1, 2, 3, 10])  # among those that are trusted anyway
    assert record.trusted(few).all()


def test_memory_is_bounded() -> None:
    record = TrackRecord()
    for first in range(0, 5 * REMEMBERED, 100):
        record.judge(first + np.arange(100), np.zeros(100, bool))
    forgotten = np.arange(100)
    latest = np.append(5 * REMEMBERED - 1, 5 * REMEMBERED + np.arange(5))
    assert record.trusted(forgotten).all()
    assert record.trusted(latest).tolist() == [False, *[True] * 5]


@pytest.mark.parametrize("seed", range(5))
def test_the_scene_is_found_though_more_segments_agree_on_something_else(seed: int) -> None:
    """Fifteen segments of the scene, and twenty of what was judged to move by itself."""
    rng = np.random.default_rng(seed)
    camera = random_velocity(rng)
    other = camera + rng.choice([-0.8, 0.8], 6)
    parts = random_segments(rng, 15, camera, SHORT), random_segments(rng, 20, other, SHORT)
    columns = ((getattr(part, name) for part in parts) for name in ("earlier", "later", "dt"))
    segments = Segments(*map(np.concatenate, map(list, columns)))
    of_scene = np.arange(35) < 15

    def found(trusted: NDArray[np.bool_] | None) -> NDArray[np.float64]:
        config = McRansacConfig(iterations=1000, refinement_tolerance=1e-12)
        fit = mc_ransac(segments, CAMERA, INFORMATION, config, 0, trusted)
        assert fit is not None and fit.inliers.shape == (35,)
        return fit.velocity

    np.testing.assert_allclose(found(None), other, atol=1e-8)
    np.testing.assert_allclose(found(of_scene), camera, atol=1e-8)
