"""Search ranges equal their definition: they contain the surrounding matches, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gpvo.config import Viso2Config
from gpvo.tracking.viso2.search_ranges import (
    STEPS,
    STEREO_STEPS,
    SearchRanges,
    everywhere,
    near_matches,
)

SHAPE, CELL, LEAST = (180, 240), 50, 20.0
CONFIG = Viso2Config(flow_radius=40, max_disparity=60, row_tolerance=1, range_cell=CELL)
WHOLE = everywhere(SHAPE, 1, CONFIG)


def random_quads(seed: int, count: int) -> NDArray[np.int32]:
    """Draw points (4, N, 2) of quads whose steps lie within the whole ranges."""
    rng = np.random.default_rng(seed)
    left = rng.integers(0, (SHAPE[1], SHAPE[0]), (count, 2))
    disparity = rng.integers(1, 30, (2, count, 1)) * [1, 0]
    flow = rng.integers(-10, 11, (count, 2))
    return np.stack([left, left - disparity[0], left + flow - disparity[1], left + flow]).astype(
        np.int32
    )


def displacements(quads: NDArray[np.int32]) -> NDArray[np.int32]:
    """Compute the displacements (STEPS, N, 2) of the steps of quads."""
    return np.stack([quads[(k + 1) % STEPS] - quads[k] for k in range(STEPS)])


def inside(ranges: SearchRanges, quads: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return which quads (N,) make only steps that the ranges allow."""
    windows, step = ranges.at(quads[0]), displacements(quads)
    return ((step >= windows[..., 0::2]) & (step <= windows[..., 1::2])).all(axis=(0, 2))


@pytest.mark.parametrize("frames_between", [1, 3])
def test_everywhere_is_the_configured_radius(frames_between: int) -> None:
    points = np.array([[0, 0], [239, 179], [120, 90]], np.int32)
    flow = 40 * frames_between
    expected = [[-60, -1, -1, 1], [-flow, flow, -flow, flow], [1, 60, -1, 1]]
    expected.append(expected[1])
    found = everywhere(SHAPE, frames_between, CONFIG).at(points)
    np.testing.assert_array_equal(found, np.repeat(np.array(expected)[:, None], 3, axis=1))


@given(st.integers(0, 2**32), st.integers(0, 12))
@settings(deadline=None, max_examples=40)
def test_ranges_are_the_extremes_of_the_matches_around(seed: int, count: int) -> None:
    quads = random_quads(seed, count)
    found, steps = near_matches(quads, WHOLE, LEAST), displacements(quads)
    cells = quads[0] // CELL
    for row in range(4):
        for column in range(5):
            near = (np.abs(cells - [column, row]) <= 1).all(axis=1)
            expected = WHOLE.windows[row, column].copy()
            for step in range(STEPS if near.any() else 0):
                for axis in range(1 if step in STEREO_STEPS else 2):
                    lowest, highest = (f(steps[step, near, axis]) for f in (np.min, np.max))
                    wider = max(0, np.ceil((LEAST - (highest - lowest)) / 2))
                    first, last = WHOLE.windows[row, column, step, 2 * axis : 2 * axis + 2]
                    expected[step, 2 * axis] = max(first, lowest - wider)
                    expected[step, 2 * axis + 1] = min(last, highest + wider)
            np.testing.assert_array_equal(found.windows[row, column], expected)


@given(st.integers(0, 2**32), st.integers(0, 40))
@settings(deadline=None, max_examples=30)
def test_ranges_hold_their_matches_and_lie_within_the_whole(seed: int, count: int) -> None:
    quads = random_quads(seed, count)
    found = near_matches(quads, WHOLE, LEAST)
    assert inside(found, quads).all()
    assert (found.windows[..., 0::2] >= WHOLE.windows[..., 0::2]).all()
    assert (found.windows[..., 1::2] <= WHOLE.windows[..., 1::2]).all()


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=30)
def test_ranges_hold_the_true_displacement_of_all_features_of_a_smooth_motion(seed: int) -> None:
    """Each cell has a match, and displacements in a cell differ by less than the least range."""
    rng = np.random.default_rng(seed)
    slope, offset = rng.uniform(-0.05, 0.05, (2, 2)), rng.uniform(-15, 15, 2)
    disparity_slope = rng.uniform(-0.02, 0.02, 2)

    def circle(left: NDArray[np.int32]) -> NDArray[np.int32]:
        from_centre = left - [120, 90]
        flow = from_centre @ slope + offset
        disparity = np.outer(20 + from_centre @ disparity_slope, [1, 0])
        quads = [left, left - disparity, left + flow - disparity, left + flow]
        return np.rint(np.stack(quads)).astype(np.int32)

    v, u = np.mgrid[0:4, 0:5]
    jitter = rng.integers(0, (48, 30), (20, 2))
    sparse = np.column_stack([u.ravel(), v.ravel()]) * CELL + jitter
    dense = rng.integers(0, (SHAPE[1], SHAPE[0]), (300, 2))
    assert inside(near_matches(circle(sparse), WHOLE, LEAST), circle(dense)).all()


def test_points_beyond_the_last_cell_belong_to_it() -> None:
    corner = np.array([[239, 179], [400, 400]], np.int32)
    row, column = WHOLE.cells(corner)
    assert row.tolist() == [3, 3] and column.tolist() == [4, 4]
