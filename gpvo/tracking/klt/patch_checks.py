"""Checks of patches: the similarity of two, and the gradient of one along the row."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.tracking.klt.patch_kernels import FAST, sample_patch

Image = NDArray[np.uint8]
Points = NDArray[np.float32]
Patch = NDArray[np.float64]


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
    window, a, b = np.empty((side + 1, side + 1)), np.empty((side, side)), np.empty((side, side))
    correlation = np.zeros(len(first_points))
    for i in range(len(first_points)):
        sample_patch(first, first_points[i, 0], first_points[i, 1], window, a)
        sample_patch(second, second_points[i, 0], second_points[i, 1], window, b)
        a -= a.mean()
        b -= b.mean()
        contrast = np.sqrt(_dot(a, a) * _dot(b, b))
        if contrast > 0:
            correlation[i] = _dot(a, b) / contrast
    return correlation


@njit(cache=True, nogil=True, fastmath=FAST)
def _dot(a: Patch, b: Patch) -> float:
    total = 0.0
    for row in range(len(a)):
        for k in range(a.shape[1]):
            total += a[row, k] * b[row, k]
    return total


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
