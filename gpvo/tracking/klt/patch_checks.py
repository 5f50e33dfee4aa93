"""Checks of patches: the similarity of two, and the gradient of one along the row."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Points = NDArray[np.float32]


@njit(cache=True, nogil=True)
def patch_correlation(
    first: Image, first_points: Points, second: Image, second_points: Points, radius: int
) -> NDArray[np.float64]:
    """Compute the zero-mean normalised cross-correlation (N,) of patches of two images.

    Points (N, 2) lie between pixels. The patches around them are 2 radius + 1 pixels wide and high,
    and the border of an image is repeated beyond it. The correlation of a patch without contrast is
    0.
    """
    side = 2 * radius + 1
    a, b = np.empty(side * side), np.empty(side * side)
    correlation = np.zeros(len(first_points))
    for i in range(len(first_points)):
        _sample(first, first_points[i, 0], first_points[i, 1], radius, a)
        _sample(second, second_points[i, 0], second_points[i, 1], radius, b)
        a -= a.mean()
        b -= b.mean()
        contrast = np.sqrt((a * a).sum() * (b * b).sum())
        if contrast > 0:
            correlation[i] = (a * b).sum() / contrast
    return correlation


@njit(cache=True, nogil=True)
def _sample(image: Image, u: float, v: float, radius: int, patch: NDArray[np.float64]) -> None:
    """Sample the patch around (u, v) bilinearly, row by row."""
    height, width = image.shape
    left, top = int(np.floor(u)), int(np.floor(v))
    x, y = u - left, v - top
    k = 0
    for row in range(top - radius, top + radius + 1):
        above, below = min(max(row, 0), height - 1), min(max(row + 1, 0), height - 1)
        for column in range(left - radius, left + radius + 1):
            here, next_ = min(max(column, 0), width - 1), min(max(column + 1, 0), width - 1)
            upper = (1 - x) * image[above, here] + x * image[above, next_]
            lower = (1 - x) * image[below, here] + x * image[below, next_]
            patch[k] = (1 - y) * upper + y * lower
            k += 1


@njit(cache=True, nogil=True)
def row_gradient(image: Image, points: Points, radius: int) -> NDArray[np.float64]:
    """Compute the root mean square (N,) of the gradient along the row in patches.

    It is in grey levels per pixel. Patches are 2 radius + 1 pixels wide and high, at the whole
    pixels nearest to points (N, 2); the border of an image is repeated beyond it.
    """
    height, width = image.shape
    gradient = np.zeros(len(points))
    for i in range(len(points)):
        u, v = int(np.rint(points[i, 0])), int(np.rint(points[i, 1]))
        total = 0
        for row in range(v - radius, v + radius + 1):
            y = min(max(row, 0), height - 1)
            for column in range(u - radius, u + radius + 1):
                before, after = max(min(column, width) - 1, 0), min(max(column, -1) + 1, width - 1)
                total += (int(image[y, after]) - int(image[y, before])) ** 2
        gradient[i] = np.sqrt(total / 4) / (2 * radius + 1)
    return gradient
