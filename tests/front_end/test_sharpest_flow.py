"""The motion that makes pictures sharpest is that of the events, whatever they show."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shown_events import shown

from gpvo.tracking.event_sums import CELL
from gpvo.tracking.sharpest_flow import FEW, sharpest_flow, sharpness_kernel

SHAPE = (120, 160)
START, STOP = 0.40, 0.45
seeds = st.integers(0, 2**32)
ways = st.tuples(st.floats(-25, 25), st.floats(-25, 25)).map(np.array)


def points_of_things(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return events' places (count, 2) on 60 small things, and their times in the cluster."""
    things = rng.uniform((0, 0), SHAPE[::-1], (60, 2))
    places = things[rng.integers(60, size=count)] + rng.normal(0, 0.4, (count, 2))
    return places, np.sort(rng.uniform(-0.5, 0.5, count))


def flow_of(points: np.ndarray, times: np.ndarray, side: int = 1) -> np.ndarray | None:
    t = 0.5 * (START + STOP) + times * (STOP - START)
    size = side * SHAPE[0], side * SHAPE[1]
    return sharpest_flow(shown(side * points + (side - 1) / 2, t, size), START, STOP, side)


@given(seeds, ways, st.sampled_from([1, 2]))
@settings(deadline=None, max_examples=15)
def test_it_is_that_of_the_events_at_both_resolutions(
    seed: int, way: np.ndarray, side: int
) -> None:
    rng = np.random.default_rng(seed)
    places, times = points_of_things(rng, 6000)
    noise = rng.uniform((0, 0), SHAPE[::-1], (600, 2))
    points = np.concatenate([places + times[:, None] * way, noise])
    times = np.concatenate([times, rng.uniform(-0.5, 0.5, 600)])
    order = np.argsort(times, kind="stable")
    flow = flow_of(points[order], times[order], side)
    assert flow is not None and flow.shape == (SHAPE[0] // CELL, SHAPE[1] // CELL, 2)
    np.testing.assert_allclose(flow * (STOP - START), np.broadcast_to(way, flow.shape), atol=2)


def test_ahead_of_a_camera_that_moves_forwards_it_comes_from_the_middle() -> None:
    places, times = points_of_things(np.random.default_rng(1), 12000)
    middle = np.array(SHAPE[::-1]) / 2
    flow = flow_of(middle + (places - middle) * (1 + 0.3 * times[:, None]), times)
    assert flow is not None
    across, down = (np.median(flow[..., k], axis=k) * (STOP - START) for k in (0, 1))
    assert across[0] < -8 and across[-1] > 8
    assert down[0] < -5 and down[-1] > 5


def test_what_rests_does_not_move() -> None:
    flow = flow_of(*points_of_things(np.random.default_rng(2), 6000))
    assert flow is not None and not flow.any()


@pytest.mark.parametrize("count", [0, FEW - 1])
def test_few_events_tell_nothing(count: int) -> None:
    assert flow_of(*points_of_things(np.random.default_rng(3), count)) is None


@given(seeds, ways, st.sampled_from([1, 2, 4]))
@settings(deadline=None, max_examples=30)
def test_sharpness_is_the_mean_number_of_others_on_a_pixel(
    seed: int, way: np.ndarray, side: int
) -> None:
    rng = np.random.default_rng(seed)
    points, times = rng.uniform(-5, 45, (500, 2)), rng.uniform(-0.5, 0.5, 500)
    is_on, size = rng.random(500) < 0.5, np.array([40, 36])
    moved = points - times[:, None] * way
    inside = ((moved >= 0) & (moved < size)).all(axis=1)
    pixels = np.column_stack([is_on, moved.astype(int) // side])[inside]
    numbers = np.unique(pixels, axis=0, return_counts=True)[1]
    expected = (numbers * (numbers - 1)).sum() / inside.sum()
    counts = np.ones((2, size[1] + 1, size[0] + 1), np.int32)
    found = sharpness_kernel(points, times, is_on, *way, side, size, counts)
    assert found == pytest.approx(expected, rel=1e-12)
