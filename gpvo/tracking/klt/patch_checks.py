"""Checks of left and right patches: on one row, similar, and distinct along the row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import fast_kernel, inlined_kernel, kernel
from gpvo.config.stages import KltConfig
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.patch_kernels import sample_patch

Image = NDArray[np.uint8]
Point = NDArray[np.float32]
Points = NDArray[np.float32]
Patch = NDArray[np.float64]
Mask = NDArray[np.bool_]


def are_stereo(images: tuple[Image, Image], left: Points, right: Points, config: KltConfig) -> Mask:
    """Check that rows agree, disparities are positive, and points (N, 2) are inside and look alike.

    The middle of a patch must be similar in both images, and distinct along the row. Contours at
    the margins of the whole patch can determine its match. They may be at another depth, while the
    middle is only noise.
    """
    passed = np.ones(len(left), np.bool_)

    def check(part: slice) -> None:
        check_kernel(images, left[part], right[part], limits_of(config), passed[part])

    in_halves(check, len(left))
    return passed


def limits_of(config: KltConfig) -> tuple[float, float, float, int]:
    """Return the limits of rows, gradient and correlation, and the radius of a patch's middle."""
    limits = config.row_tolerance, config.min_row_gradient, config.min_correlation
    return *limits, config.side // 4


@kernel
def check_kernel(
    images: tuple[Image, Image],
    left: Points,
    right: Points,
    limits: tuple[float, float, float, int],
    passed: Mask,
) -> None:
    """Clear the marks (N,) of those that fail; see `are_stereo`."""
    (image, other), radius = images, limits[3]
    for i in np.flatnonzero(passed):
        a, b = left[i], right[i]
        passed[i] = (
            _is_inside(image, a)
            and _is_inside(other, b)
            and a[0] > b[0]
            and abs(a[1] - b[1]) < limits[0]
            and row_gradient(image, a, radius) >= limits[1]
            and patch_correlation(image, a, other, b, radius) >= limits[2]
        )


@kernel
def _is_inside(image: Image, point: Point) -> bool:
    height, width = image.shape
    return 0 <= point[0] < width and 0 <= point[1] < height


@inlined_kernel
def patch_correlation(
    first: Image, point: Point, second: Image, other: Point, radius: int
) -> float:
    """Compute the zero-mean normalised cross-correlation of patches of two images.

    Points (2,) lie between pixels. The patches around them are 2 radius + 1 pixels wide and high,
    and the border of an image is repeated beyond it. The correlation of a patch without contrast is
    0.
    """
    side = 2 * radius + 1
    window, a, b = np.empty((side + 1, side + 1)), np.empty((side, side)), np.empty((side, side))
    sample_patch(first, point[0], point[1], window, a)
    sample_patch(second, other[0], other[1], window, b)
    a -= a.mean()
    b -= b.mean()
    contrast = np.sqrt(_dot(a, a) * _dot(b, b))
    return _dot(a, b) / contrast if contrast > 0 else 0.0


@fast_kernel
def _dot(a: Patch, b: Patch) -> float:
    total = 0.0
    for row in range(len(a)):
        for k in range(a.shape[1]):
            total += a[row, k] * b[row, k]
    return total


@kernel
def row_gradient(image: Image, point: Point, radius: int) -> float:
    """Compute the root mean square of the gradient along the row in a patch.

    It is in grey levels per pixel. The patch is 2 radius + 1 pixels wide and high, at the whole
    pixel nearest to the point (2,); the border of an image is repeated beyond it.
    """
    height, width = image.shape
    u, v = int(np.rint(point[0])), int(np.rint(point[1]))
    total = 0
    for row in range(v - radius, v + radius + 1):
        y = min(max(row, 0), height - 1)
        for column in range(u - radius, u + radius + 1):
            before, after = max(min(column, width) - 1, 0), min(max(column, -1) + 1, width - 1)
            total += (int(image[y, after]) - int(image[y, before])) ** 2
    return float(np.sqrt(total / 4) / (2 * radius + 1))
