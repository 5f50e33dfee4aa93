"""Refinement of matches to the smallest patch difference and the parabola around it.

LIBVISO2's refinement: a small patch of gradients is compared over 7 x 7 positions around the match.
Refinement to whole pixels uses 5 x 5 positions.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel

# (dx, dy, index of the gradient): a diamond of horizontal gradients and a cross of vertical ones.
PATCH = np.array(
    [
        (dx, dy, 0)
        for dx, dy in (
            (0, -2), (-2, -1), (0, -1), (2, -1), (-1, 0), (0, 0),
            (0, 0), (1, 0), (-2, 1), (0, 1), (2, 1), (0, 2),
        )
    ]
    + [(dx, dy, 1) for dx, dy in ((0, -1), (-1, 0), (1, 0), (0, 1))]
)  # fmt: skip
SEARCH_RADIUS = 3  # pixels
PIXEL_SEARCH_RADIUS = 2
PATCH_RADIUS = 2
REACH = PATCH_RADIUS + SEARCH_RADIUS + 1  # a point needs this distance from the border


def patches(gradient: NDArray[np.uint8], points: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Sample the gradient (N, 16) around points (N, 2); see `gpvo.tracking.features.gradients`."""
    columns = points[:, 0, None] + PATCH[:, 0]
    rows = points[:, 1, None] + PATCH[:, 1]
    return gradient[rows, columns, PATCH[:, 2]]


def refine(
    gradient: NDArray[np.uint8],
    points: NDArray[np.int32],
    reference: NDArray[np.uint8],
    how: Literal["none", "pixel", "subpixel"] = "subpixel",
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Find positions (N, 2) near points where the image looks like the reference (N, 16).

    Also returned is a mask (N,). It is False if the best position is on the border of the search
    window, the point is near the border of the image, or the parabola has no minimum within a
    pixel. Without subpixel refinement the mask is True, and points at the border of the image stay.
    """
    if how == "none":
        return points.astype(np.float64), np.ones(len(points), bool)
    radius = SEARCH_RADIUS if how == "subpixel" else PIXEL_SEARCH_RADIUS
    costs = np.full((len(points), 2 * radius + 1, 2 * radius + 1), np.inf)
    _fill_costs(costs, gradient, points.astype(np.int64), reference, PATCH)
    return _parabola_minimum(costs, points) if how == "subpixel" else _least(costs, points)


@kernel
def _fill_costs(
    costs: NDArray[np.float64],
    gradient: NDArray[np.uint8],
    points: NDArray[np.int64],
    reference: NDArray[np.uint8],
    patch: NDArray[np.int64],
) -> None:
    height, width, _ = gradient.shape
    radius = costs.shape[1] // 2
    for i in range(len(points)):
        u, v = points[i]
        if not (REACH <= u < width - REACH and REACH <= v < height - REACH):
            continue
        for row in range(costs.shape[1]):
            for column in range(costs.shape[2]):
                total = 0
                for k in range(len(patch)):
                    y = v + row - radius + patch[k, 1]
                    x = u + column - radius + patch[k, 0]
                    total += abs(np.int64(gradient[y, x, patch[k, 2]]) - reference[i, k])
                costs[i, row, column] = total


def _least(
    costs: NDArray[np.float64], points: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Find the position of the lowest cost; points without costs stay."""
    side = costs.shape[1]
    row, column = np.divmod(costs.reshape(len(costs), side * side).argmin(axis=1), side)
    known = np.isfinite(costs[:, 0, 0])
    moved = points + np.stack([column, row], axis=1) - side // 2
    return np.where(known[:, None], moved, points).astype(np.float64), np.ones(len(points), bool)


def _parabola_minimum(
    costs: NDArray[np.float64], points: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Compute the minimum of the paraboloid fitted to the 3 x 3 costs around the lowest one."""
    side = costs.shape[1]
    lowest = costs.reshape(len(costs), side * side).argmin(axis=1)
    row, column = np.divmod(lowest, side)
    inside = (row > 0) & (row < side - 1) & (column > 0) & (column < side - 1)
    inside &= np.isfinite(costs[:, 0, 0])
    row, column = np.clip(row, 1, side - 2), np.clip(column, 1, side - 2)
    point, near = np.arange(len(costs))[:, None, None], np.arange(-1, 2)
    around = costs[point, row[:, None, None] + near[:, None], column[:, None, None] + near]
    around = np.where(inside[:, None, None], around, 0.0)
    # Closed-form least squares of a x^2 + b y^2 + c xy + d x + e y + g on the 3 x 3 grid.
    sum_x, sum_y = around.sum(axis=1), around.sum(axis=2)
    a = sum_x[:, 0] / 6 - sum_x[:, 1] / 3 + sum_x[:, 2] / 6
    b = sum_y[:, 0] / 6 - sum_y[:, 1] / 3 + sum_y[:, 2] / 6
    c = (around[:, 0, 0] + around[:, 2, 2] - around[:, 0, 2] - around[:, 2, 0]) / 4
    d, e = (sum_x[:, 2] - sum_x[:, 0]) / 6, (sum_y[:, 2] - sum_y[:, 0]) / 6
    determinant = 4 * a * b - c * c
    found = inside & (determinant > 1e-8) & (a > 0)
    safe = np.where(found, determinant, 1.0)
    offset = np.stack([(c * e - 2 * b * d) / safe, (c * d - 2 * a * e) / safe], axis=1)
    found &= (np.abs(offset) < 1).all(axis=1)
    corner = points + np.stack([column, row], axis=1) - SEARCH_RADIUS
    return np.where(found[:, None], corner + offset, points), found
