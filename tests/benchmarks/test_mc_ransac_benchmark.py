"""Fast MC-RANSAC against plain numpy, and why it is refined twice."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.mc_ransac import (
    CAMERA,
    INFORMATION,
    Case,
    frame_based_inliers,
    numpy_fast_mc_ransac,
)
from gpvo.config import McRansacConfig
from gpvo.mc_ransac import fast_mc_ransac, mc_ransac
from gpvo.mc_ransac.segments import are_inliers


@pytest.mark.parametrize("outliers", [0.0, 0.5])
@pytest.mark.parametrize("turn", [0.5, 8.0])
def test_fast_version_is_that_of_plain_numpy(outliers: float, turn: float) -> None:
    """The same samples, the same best one: equal to rounding, and the same inliers exactly."""
    segments, _ = Case(outliers=outliers, turn=turn).segments(80, 5)
    config = McRansacConfig(iterations=150, confidence=1)
    plain = numpy_fast_mc_ransac(segments, CAMERA, config, np.random.default_rng(1))
    ours = fast_mc_ransac(segments, CAMERA, config, np.random.default_rng(1))
    np.testing.assert_allclose(ours, plain, rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(
        are_inliers(segments, CAMERA, ours, config),
        are_inliers(segments, CAMERA, plain, config),
    )


def test_refining_again_finds_segments_that_once_misses() -> None:
    found, good = {1: 0, 2: 0}, 0
    for seed in range(10):
        segments, true = Case().segments(120, seed)
        good += int(true.sum())
        for refinements in found:
            config = McRansacConfig(refinements=refinements)
            fit = mc_ransac(segments, CAMERA, INFORMATION, config, np.random.default_rng(0))
            assert fit is not None and not (fit.inliers & ~true).any()
            found[refinements] += int(fit.inliers.sum())
    assert found[1] < found[2] > 0.97 * good


def test_common_times_lose_turning_tracklets() -> None:
    """Durations that differ bend the discrete transform, not the constant velocity."""
    kept = {}
    for spread in (0.0, 0.6):
        segments, true = Case(turn=3.0, spread=spread, outliers=0.2).segments(120, 0)
        kept[spread] = (frame_based_inliers(segments, McRansacConfig()) & true).sum() / true.sum()
    assert kept[0.0] > 0.9 and kept[0.6] < 0.5
