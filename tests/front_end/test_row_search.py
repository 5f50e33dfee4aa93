"""The search along rows compared with OpenCV's template matching, and with known disparities."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from front_end_scenes import CAMERA, WIDTH, random_binary, random_grey, track, window
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.config import TrackingConfig
from gpvo.tracking.features import smooth
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.klt.lucas_kanade import BEYOND, Pyramid
from gpvo.tracking.klt.row_search import FARTHEST, LEVEL, NEARER, RADIUS, search_rows

SIDE = 15
LEFT, RIGHT = (Pyramid.of_image(random_grey(seed, 200), SIDE, 2) for seed in (1, 2))
COLUMNS, REACH = 100, int(FARTHEST * 200 * 0.5**LEVEL)


def disparity(image: Pyramid, other: Pyramid, u: int, v: int, reach: int) -> int:
    """Search the pixel (u, v) of the level by OpenCV, to the right if the reach is negative."""
    first = min(u, u - reach)
    width, corner = 2 * RADIUS + 1, SIDE + BEYOND - RADIUS
    template, row = (one.levels[LEVEL][v + corner :][:width] for one in (image, other))
    strip = row[:, first + corner :][:, : abs(reach) + width]
    alike = cv2.matchTemplate(strip, template[:, u + corner :][:, :width], cv2.TM_CCOEFF_NORMED)[0]
    best, found = 0.0, 0
    for d, one in enumerate(alike[::-1] if reach > 0 else alike):
        if one > best + NEARER * (best > 0 and d != found + 1):
            best, found = one, d
    return found


@given(st.integers(0, 99), st.integers(0, 99))
@settings(deadline=None, max_examples=100)
def test_the_nearest_of_the_most_alike_is_found_if_it_leads_back(u: int, v: int) -> None:
    scale = 2**LEVEL
    ends, found = search_rows(LEFT, RIGHT, np.array([[u, v]], np.float32) * scale)
    there = disparity(LEFT, RIGHT, u, v, min(REACH, u))
    back = disparity(RIGHT, LEFT, u - there, v, -min(REACH, COLUMNS - 1 - u + there))
    np.testing.assert_array_equal(ends, [[scale * (u - there), scale * v]])
    assert found == [abs(there - back) <= 1]


@pytest.mark.parametrize("shift", [3, 20, 45, 78])
def test_features_are_matched_at_any_disparity(shift: int) -> None:
    """Up to a third of the image's width, exactly where both images show the whole patch."""
    assert shift <= FARTHEST * WIDTH
    image = random_binary(4)
    tracker = KltTracker(TrackingConfig(), CAMERA)
    left, right = window(image, 0, 0), window(image, -shift, 0)
    seen = track(tracker, left, right)
    tracker.follow(left, right)  # its report says how many there were
    within = tracker.report.features * (1 - shift / WIDTH)
    assert len(seen) > 0.8 * within
    whole = seen.right[:, 0] > TrackingConfig().klt.side // 2
    assert np.mean(np.abs(seen.disparity - shift)[whole] < 0.1) > 0.95


def test_a_blank_image_has_no_disparities() -> None:
    blank = Pyramid.of_image(smooth(np.zeros((60, 80), np.uint8), 0.7), 15, 2)
    points = np.array([[40, 30], [0, 0], [79, 59]], np.float32)
    np.testing.assert_array_equal(search_rows(blank, blank, points)[0], points)
