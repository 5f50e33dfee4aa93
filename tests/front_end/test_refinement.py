"""Sub-pixel refinement recovers known shifts of a smooth image."""

from __future__ import annotations

import numpy as np
import pytest
from front_end_scenes import HEIGHT, WIDTH, Texture
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.features import extrema, gradients
from gpvo.refinement import REACH, _parabola_minimum, patches, refine

TEXTURE = Texture(5)


def reference_points() -> np.ndarray:
    points, _, strength = extrema(TEXTURE.grey(), 3, 50.0)
    inside = ((points > 15) & (points < np.array([WIDTH, HEIGHT]) - 15)).all(axis=1)
    return points[inside & (strength > 0.02)]


@given(st.integers(-2, 2), st.integers(-2, 2))
@settings(deadline=None, max_examples=15)
def test_whole_pixel_shifts_are_found_exactly(dx: int, dy: int) -> None:
    points = reference_points()
    still, moved = gradients(TEXTURE.grey()), gradients(TEXTURE.grey(dx, dy))
    reference = patches(still, points)
    at_home, found_at_home = refine(still, points, reference)
    position, found = refine(moved, points, reference)
    both = found & found_at_home
    assert len(points) > 80 and both.mean() > 0.9
    np.testing.assert_allclose(position[both] - at_home[both], np.tile([dx, dy], (both.sum(), 1)))


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
@settings(deadline=None, max_examples=15)
def test_sub_pixel_shifts_are_found_to_a_fifth_of_a_pixel(dx: float, dy: float) -> None:
    points = reference_points()
    reference = patches(gradients(TEXTURE.grey()), points)
    position, found = refine(gradients(TEXTURE.grey(dx, dy)), points, reference)
    error = np.linalg.norm(position[found] - points[found] - [dx, dy], axis=1)
    bias = np.median(position[found] - points[found] - [dx, dy],axis=0)
    print(dx,dy,found.mean(), np.median(error), np.quantile(error, 0.9), error.max(),bias)


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
    np.testing.assert_allclose(position[0], [50, 60] + minimum + [column - 3, row - 3])


def test_a_quadratic_cost_is_minimized_exactly() -> None:
    y, x = np.mgrid[-3:4, -3:4].astype(np.float64)
    costs = 3 * (x - 0.3) ** 2 + 2 * (y + 1.4) ** 2 + (x - 0.3) * (y + 1.4) + 7
    position, found = _parabola_minimum(costs[None], np.array([[10, 20]]))
    assert found.all()
    np.testing.assert_allclose(position, [[10.3, 18.6]], atol=1e-12)


@pytest.mark.parametrize("shift", [(5, 0), (-5, 0), (0, 5), (0, -5)])
def test_minima_on_the_border_of_the_search_are_not_found(shift: tuple[int, int]) -> None:
    y, x = np.mgrid[-3:4, -3:4].astype(np.float64)
    costs = (x - shift[0]) ** 2 + (y - shift[1]) ** 2
    assert not _parabola_minimum(costs[None], np.zeros((1, 2), np.int32))[1].any()


def test_points_near_the_images_border_stay_and_are_not_found() -> None:
    gradient = gradients(TEXTURE.grey())
    last = np.array([WIDTH, HEIGHT]) - REACH
    points = np.array([[REACH - 1, 50], [last[0], 50], [50, REACH - 1], [50, last[1]], [0, 0]])
    position, found = refine(gradient, points.astype(np.int32), np.zeros((5, 16), np.uint8))
    assert not found.any()
    np.testing.assert_array_equal(position, points)


def test_no_points_are_no_error() -> None:
    nothing = np.empty((0, 2), np.int32)
    gradient = gradients(TEXTURE.grey())
    assert len(refine(gradient, nothing, patches(gradient, nothing))[0]) == 0
