"""Patches: how alike two of them look, and how much a shift along the row changes one."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Points = NDArray[np.float32]


@njit(cache=True)
def patch_correlation(
    first: Image, first_points: Points, second: Image, second_points: Points, radius: int
) -> NDArray[np.float64]:
    """Zero-mean normalised cross-correlation (N,) of patches around points of two images.

    Points (N, 2) lie between pixels, patches are 2 radius + 1 pixels wide and high, and an image's
    border is repeated beyond it. Patches without contrast correlate with nothing: 0.
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


@njit(cache=True)
def _sample(image: Image, u: float, v: float, radius: int, patch: NDArray[np.float64]) -> None:
    """Bilinear samples of the patch around (u, v), row by row."""
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


def row_gradient(image: Image, points: Points, radius: int) -> NDArray[np.float64]:
    """Root mean square (N,) of the gradient along the row in patches around points (N, 2).

    Grey levels per pixel, in patches 2 radius + 1 pixels wide and high at the nearest whole pixel.
    """
    gradient = cv2.filter2D(image, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], np.float32))
    side = 2 * radius + 1
    energy = cv2.blur(gradient * gradient, (side, side))
    last = np.array(image.shape[::-1]) - 1
    column, row = np.clip(np.rint(points), 0, last).astype(np.int64).T
    return np.sqrt(energy[row, column].astype(np.float64))
