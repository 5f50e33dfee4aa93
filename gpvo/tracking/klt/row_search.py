"""Search of features along the rows of the other camera's image, where nothing is known of depth.

A match by gradients begins within a few pixels, and near things are tens of pixels apart in both
images. So the patches of a coarse level are compared at every disparity first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import fast_kernel, inner_kernel, kernel
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.lucas_kanade import BEYOND, Pyramid
from gpvo.tracking.klt.patch_kernels import Level, centre, copy_patch, dot

Points = NDArray[np.float32]
Mask = NDArray[np.bool_]
Work = NDArray[np.float32]

LEVEL = 1
"""Level that is searched: a step of a pixel there is two pixels of the image."""
RADIUS = 7
"""Half of the compared patches' side, pixels of the level."""
FARTHEST = 1 / 3
"""Largest disparity, share of the image's width."""
NEARER = 0.1
"""Correlation by which a larger disparity must be more alike: few things are that near."""


def search_rows(left: Pyramid, right: Pyramid, points: Points) -> tuple[Points, Mask]:
    """Search the points (N, 2) of the left image along their rows of the right one.

    Returns the right points (N, 2) that look most alike, and which of those (N,) find the left ones
    in the same way: others are one of several that look alike.
    """
    ends, found = points.copy(), np.zeros(len(points), np.bool_)
    level = min(LEVEL, left.coarsest)
    border, reach = left.patch_size + BEYOND, int(FARTHEST * left.image.shape[1] * 0.5**level)
    images = left.levels[level], right.levels[level]

    def search(part: slice) -> None:
        given = *images, border, reach, np.float32(0.5**level)
        search_kernel(*given, points[part], ends[part], found[part])

    in_halves(search, len(points))
    return ends, found


@kernel
def search_kernel(
    left: Level,
    right: Level,
    border: int,
    reach: int,
    scale: float,
    points: Points,
    ends: Points,
    found: Mask,
) -> None:
    """Move the columns of points (N, 2) by the disparity, and mark those that are found (N,)."""
    side, first, last = 2 * RADIUS + 1, border - RADIUS, left.shape[1] - 1 - border - RADIUS
    patches, sums = np.empty((2, side * side), np.float32), np.empty((3, reach + 1), np.float32)
    for i in range(len(points)):
        start = min(first + int(np.rint(points[i, 0] * scale)), last)
        top, farthest = first + int(np.rint(points[i, 1] * scale)), min(reach, start - first)
        disparity = _most_alike(left, start, top, right, -1, farthest, patches, sums)
        end, farthest = start - disparity, min(reach, last - start + disparity)
        back = _most_alike(right, end, top, left, 1, farthest, patches, sums)
        found[i] = abs(back - disparity) <= 1
        ends[i, 0] = points[i, 0] - disparity / scale


@inner_kernel
def _most_alike(
    image: Level,
    column: int,
    row: int,
    other: Level,
    step: int,
    farthest: int,
    patches: Work,
    sums: Work,
) -> int:
    """Return how many steps from (column, row) the patch there is in the other image."""
    begin, alike, count = min(column, column + step * farthest), sums[0], farthest + 1
    _correlate(image, column, row, other, begin, count, patches, sums)
    best, steps = 0.0, 0
    for k in range(count):
        one = alike[k] if step > 0 else alike[farthest - k]
        same_peak = best == 0.0 or k == steps + 1
        if one > (best if same_peak else best + NEARER):
            best, steps = float(one), k
    return steps


@fast_kernel
def _correlate(
    image: Level,
    column: int,
    row: int,
    other: Level,
    first: int,
    count: int,
    patches: Work,
    sums: Work,
) -> None:
    """Compute the zero-mean normalised cross-correlations of a patch with those of another image.

    The patch begins at (column, row), the others at so many columns from the first on. `sums`
    (3, D) has the correlations in its first row. The two patches are to work in.
    """
    size, template = 2 * RADIUS + 1, patches[1]
    copy_patch(image, float(column), float(row), size, size, patches[0])
    centre(patches[0], size, size, template)
    contrast = dot(template, template)
    side, n = np.uint64(size), np.uint64(count)
    top, left = np.uint64(row), np.uint64(first)  # no negative indices
    products, totals, squares = sums[0], sums[1], sums[2]
    for k in range(n):
        products[k] = totals[k] = squares[k] = 0
    for y in range(side):
        for x in range(side):
            weight = template[y * side + x]
            for k in range(n):
                value = np.float32(other[top + y, left + x + k])
                products[k] += weight * value
                totals[k] += value
                squares[k] += value * value
    for k in range(n):
        variance = float(squares[k]) - float(totals[k]) ** 2 / float(side * side)
        known = variance * contrast > 0
        products[k] = products[k] / np.sqrt(variance * contrast) if known else 0.0
