"""Landmarks are found away from where they are expected if several are away alike."""

from __future__ import annotations

import numpy as np
import pytest
from front_end_scenes import random_picture
from numpy.typing import NDArray

from gpvo.tracking.klt.anchors import Anchors
from gpvo.tracking.klt.drifted_search import LEAST_DRIFTED, REACH, match_drifted
from gpvo.tracking.klt.lucas_kanade import Pyramid
from gpvo.tracking.sights import UPRIGHT, Sights

SIDE, SHAPE = 21, (160, 200)
TOLERANCE, LEAST_CORRELATION = 3.0, 0.8


def find(drift: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Search landmarks that drifted so (N, 2); tell which are found, and how far off (N,)."""
    image = Pyramid.of_image(random_picture(2, SHAPE), SIDE, 1)
    places = np.random.default_rng(3).uniform([40, 40], [160, 120], drift.shape)
    points = places.astype(np.float32)
    sights = Sights.of_frame(points, points - np.float32([10.0, 0.0]), np.eye(4))
    anchors, warps = Anchors.of_image(image, sights), np.tile(UPRIGHT, (len(points), 1, 1))
    expected = (points - drift).astype(np.float32)
    left, alike = match_drifted(anchors, warps, image, expected, TOLERANCE, LEAST_CORRELATION)
    return alike >= LEAST_CORRELATION, np.linalg.norm(left - points, axis=1)


@pytest.mark.parametrize("angle", np.linspace(0, 2 * np.pi, 9))
@pytest.mark.parametrize("distance", [0.0, 2.0, 4.0, 1.2 * float(REACH)])
def test_a_drift_of_all_is_found(distance: float, angle: float) -> None:
    found, error = find(np.tile(distance * np.array([np.cos(angle), np.sin(angle)]), (12, 1)))
    assert found.sum() >= 10
    assert error[found].max() < 0.1


def test_a_landmark_is_not_found_far_away_alone() -> None:
    found, error = find(np.tile([REACH, 0.0], (LEAST_DRIFTED - 1, 1)))
    assert not found.any()
    directions = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    apart = 2 * TOLERANCE * np.stack([np.cos(directions), np.sin(directions)], axis=1)
    found, error = find(np.vstack([apart, np.zeros((4, 2))]))
    assert not found[:8].any()
    assert found[8:].all() and error[8:].max() < 0.1
