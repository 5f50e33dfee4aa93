"""Refinement recovers known shifts of a smooth image, of whole pixels or fractions of them."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, shift

from gpvo.tracking.features import extrema, gradients
from gpvo.tracking.viso2.subpixel_refinement import PATCH, REACH, _parabola_minimum, patches, refine

NOISE = gaussian_filter(np.random.default_rng(1).normal(size=(300, 360)), 2.0)


def image(dx: float = 0.0, dy: float = 0.0) -> NDArray[np.uint8]:
    """Draw smooth noise moved by (dx, dy) pixels."""
    moved = shift(128 + 400 * NOISE, (dy, dx), order=5)
    return np.clip(np.rint(moved[60:240, 60:300]), 0, 255).astype(np.uint8)


def distinct_points() -> NDArray[np.int32]:
    points, _, response = extrema(image(), 3, 50.0)
    inside = ((points > 15) & (points < np.array(image().shape[::-1]) - 15)).all(axis=1)
    return points[inside & (response > 200)]


@given(st.integers(-2, 2), st.integers(-2, 2))
@settings(deadline=None, max_examples=5)
def test_whole_pixel_shifts_are_found_exactly(dx: int, dy: int) -> None:
    points, still = distinct_points(), gradients(image())
    reference = patches(still, points)
    at_home, found_at_home = refine(still, points, reference)
    position, found = refine(gradients(image(dx, dy)), points, reference)
    both = found & found_at_home
    assert both.mean() > 0.95
    np.testing.assert_allclose(position[both], at_home[both] + [dx, dy], atol=1e-9)


@pytest.mark.parametrize("moved", [(0.25, 0.0), (0.0, -0.4), (0.5, 0.5), (-0.3, 0.4), (1.2, -0.7)])
def test_sub_pixel_shifts_are_found(moved: tuple[float, float]) -> None:
    """The error is below 0.2 pixels in the median and below 0.45 in nine of ten points.

    Absolute differences have a sharper minimum than the parabola through them. The parabola is
    therefore biased to whole pixels, by less than 0.1 pixels.
    """
    points = distinct_points()
    reference = patches(gradients(image()), points)
    position, found = refine(gradients(image(*moved)), points, reference)
    error = (position - points - moved)[found]
    distance = np.linalg.norm(error, axis=1)
    assert len(points) > 500 and found.mean() > 0.7
    assert np.median(distance) < 0.2 and np.quantile(distance, 0.9) < 0.45
    assert (np.abs(np.median(error, axis=0)) < 0.1).all()


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=30)
def test_parabola_is_the_least_squares_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[-3:4, -3:4].astype(np.float64)
    at, curvature = rng.uniform(-1.5, 1.5, 2), rng.uniform(1, 3, 2)
    costs = curvature[0] * (x - at[0]) ** 2 + curvature[1] * (y - at[1]) ** 2
    costs += 0.5 * (x - at[0]) * (y - at[1]) + rng.normal(0, 0.05, costs.shape)
    position, found = _parabola_minimum(costs[None], np.array([[50, 60]]))

    row, column = np.unravel_index(costs.argmin(), costs.shape)
    X, Y = x[:3, :3].ravel() + 2, y[:3, :3].ravel() + 2
    design = np.column_stack([X**2, Y**2, X * Y, X, Y, np.ones(9)])
    around = costs[row - 1 : row + 2, column - 1 : column + 2]
    a, b, c, d, e, _ = np.linalg.lstsq(design, around.ravel())[0]
    minimum = np.linalg.solve([[2 * a, c], [c, 2 * b]], [-d, -e])
    assert found.all()
    minimum += np.array([column - 3, row - 3])
    np.testing.assert_allclose(position[0] - [50, 60], minimum, atol=1e-9)


def test_a_quadratic_cost_is_minimized_exactly() -> None:
    y, x = np.mgrid[-3:4, -3:4].astype(np.float64)
    costs = 3 * (x - 0.3) ** 2 + 2 * (y + 1.4) ** 2 + (x - 0.3) * (y + 1.4) + 7
    position, found = _parabola_minimum(costs[None], np.array([[10, 20]]))
    assert found.all()
    np.testing.assert_allclose(position, [[10.3, 18.6]], atol=1e-12)


@pytest.mark.parametrize("at", [(5, 0), (-5, 0), (0, 5), (0, -5)])
def test_minima_on_the_border_of_the_search_are_not_found(at: tuple[int, int]) -> None:
    y, x = np.mgrid[-3:4, -3:4].astype(np.float64)
    costs = (x - at[0]) ** 2 + (y - at[1]) ** 2
    assert not _parabola_minimum(costs[None], np.zeros((1, 2), np.int32))[1].any()


def test_points_near_the_images_border_stay_and_are_not_found() -> None:
    gradient = gradients(image())
    last = np.array(gradient.shape[1::-1]) - REACH
    points = np.array([[REACH - 1, 50], [last[0], 50], [50, REACH - 1], [50, last[1]], [0, 0]])
    position, found = refine(gradient, points.astype(np.int32), np.zeros((5, 16), np.uint8))
    assert not found.any()
    np.testing.assert_array_equal(position, points)


def test_no_points_are_no_error() -> None:
    nothing = np.empty((0, 2), np.int32)
    gradient = gradients(image())
    assert len(refine(gradient, nothing, patches(gradient, nothing))[0]) == 0


@given(st.integers(-2, 2), st.integers(-2, 2))
@settings(deadline=None, max_examples=10)
def test_pixels_are_refined_to_the_least_difference(dx: int, dy: int) -> None:
    points, moved = distinct_points(), gradients(image(dx + 0.3, dy - 0.2))
    reference = patches(gradients(image()), points)
    position, found = refine(moved, points, reference, "pixel")
    assert found.all() and (position == np.rint(position)).all()
    assert (position - points == [dx, dy]).all(axis=1).mean() > 0.8

    for point, patch, best in zip(points[:50], reference, position, strict=False):
        costs = {}
        for row, column in np.ndindex(5, 5):
            centre = point + np.array([column, row]) - 2
            at = centre + PATCH[:, :2]
            seen = moved[at[:, 1], at[:, 0], PATCH[:, 2]].astype(int)
            costs[tuple(centre)] = np.abs(seen - patch).sum()
        assert min(costs, key=costs.__getitem__) == tuple(best)


@pytest.mark.parametrize("how", ["none", "pixel"])
def test_whole_pixels_stay_at_the_images_border(how: Literal["none", "pixel"]) -> None:
    gradient = gradients(image())
    points = np.array([[0, 0], [REACH - 1, 50], [239, 179]], np.int32)
    position, found = refine(gradient, points, np.zeros((3, 16), np.uint8), how)
    assert found.all()
    np.testing.assert_array_equal(position, points)


def test_no_refinement_leaves_points_where_they_are() -> None:
    points, gradient = distinct_points(), gradients(image(1, 1))
    position, found = refine(gradient, points, patches(gradient, points + 1), "none")
    assert found.all()
    np.testing.assert_array_equal(position, points)
