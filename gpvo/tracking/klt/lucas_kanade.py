"""Lucas-Kanade matching of patches from coarse to fine, with image pyramids that are kept.

Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker", 2000, in the inverse form
of OpenCV's calcOpticalFlowPyrLK: the gradients are those of the source patch, so that a patch is
prepared once and every iteration samples the target only. OpenCV makes both pyramids in every call.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import inner_kernel, kernel
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.patch_kernels import (
    Level,
    Row,
    clear_outside,
    copy_patch,
    corner_sums,
    corner_weights,
    dot,
    sample_gradients,
    weighted_sum,
)

Image = NDArray[np.uint8]
Points = NDArray[np.float32]
Mask = NDArray[np.bool_]
Pairs = tuple[tuple[Level, Level], ...]
"""Levels of the source and the target, from the finest on."""

ITERATIONS = 30
"""Most steps at one level."""
ACCURACY = 0.01
"""Length of a step at which a match has converged, pixels."""
LEAST_GRADIENT = 0.32
"""Least root mean square gradient of a patch in any direction, grey levels per pixel."""
BEYOND = 2
"""Pixels around the farthest patch that are copied with it."""


@dataclass(frozen=True, eq=False)
class Pyramid:
    """Levels of an image, each half as large as the one before, for patches of one size.

    Attributes
    ----------
    image
        (height, width) uint8.
    levels
        uint8 images with a border, which mirrors the image, so that patches may reach beyond it.
        The coarsest one is repeated where the image is too small for all of them: kernels would be
        compiled again for each number of levels.
    patch_size
        Side of the patches, pixels.
    coarsest
        Index of the coarsest level.
    """

    image: Image
    levels: list[Level]
    patch_size: int
    coarsest: int

    @staticmethod
    def of_image(image: Image, patch_size: int, coarser: int) -> Pyramid:
        """Make up to `coarser` levels above an image (height, width), larger than a patch."""
        smaller, levels = image, [_bordered(image, patch_size)]
        while len(levels) <= coarser and min(smaller.shape) > 2 * patch_size:
            smaller = cv2.pyrDown(smaller)
            levels.append(_bordered(smaller, patch_size))
        coarsest = len(levels) - 1
        levels += [levels[-1]] * (coarser - coarsest)
        return Pyramid(image, levels, patch_size, coarsest)


def _bordered(image: Image, patch_size: int) -> Level:
    sides = (patch_size + BEYOND,) * 4
    return cv2.copyMakeBorder(image, *sides, cv2.BORDER_REFLECT_101)


def match_patches(
    source: Pyramid, target: Pyramid, points: Points, guess: Points, coarser: int
) -> tuple[Points, Mask]:
    """Match the patches around points (N, 2) of the source with the target image.

    The search begins at the guess (N, 2), at most `coarser` levels above the image. Returns the
    points in the target (N, 2) and whether they were found (N,): the patch has gradients in all
    directions, and its match is not beyond the image.
    """
    ends, found = guess.astype(np.float32), np.zeros(len(points), np.bool_)
    pairs, coarsest = pairs_of_levels(source, target), min(coarser, source.coarsest)

    def match(part: slice) -> None:
        match_levels(pairs, coarsest, source.patch_size, points[part], ends[part], found[part])

    in_halves(match, len(points))
    return ends, found


def pairs_of_levels(source: Pyramid, target: Pyramid) -> Pairs:
    """Return the levels of both pyramids."""
    return tuple(zip(source.levels, target.levels, strict=True))


@kernel
def match_levels(
    pairs: Pairs, coarsest: int, side: int, points: Points, ends: Points, found: Mask
) -> None:
    """Refine the ends (N, 2) of points (N, 2), from the coarsest of the levels to use on."""
    for level in range(coarsest, -1, -1):
        scale, scaled = np.float32(0.5**level), np.empty_like(points)
        for i in range(len(points)):
            for k in range(2):
                scaled[i, k], ends[i, k] = points[i, k] * scale, ends[i, k] * scale
        _match_level(*pairs[level], side, scaled, ends, found)
        for i in range(len(points)):
            for k in range(2):
                ends[i, k] /= scale


@inner_kernel
def _match_level(
    source: Level, target: Level, side: int, points: Points, ends: Points, found: Mask
) -> None:
    """Refine the ends (N, 2) of points (N, 2) in pixels of the level, and tell which are found."""
    width = side + 3  # of the rows of all patches, which are stored one after the other
    size = (side + 3) * width + 2
    window, samples = np.zeros(size, np.float32), np.zeros(size, np.float32)
    across, down = np.zeros(side * width, np.float32), np.zeros(side * width, np.float32)
    corner = side + BEYOND - side // 2  # from the centre of a patch to its first pixel
    for i in range(len(points)):
        u, v = points[i, 0] + corner, points[i, 1] + corner
        found[i] = touches(source, side, u, v)
        if found[i]:
            sample_gradients(source, u, v, side, width, window, samples, across, down)
            columns = inside(u, source.shape[1], side)
            clear_outside(columns, inside(v, source.shape[0], side), width, across, down)
            still = dot(samples[width + 1 :], across), dot(samples[width + 1 :], down)
            found[i] = refine(target, side, across, down, still, window, corner, ends[i])


@kernel
def touches(image: Level, side: int, u: float, v: float) -> bool:
    """Check that a patch with its first pixel at (u, v) is not beyond the image."""
    height, width = image.shape
    last = side + BEYOND
    return BEYOND <= u < width - last and BEYOND <= v < height - last


@kernel
def inside(start: float, size: int, side: int) -> tuple[int, int]:
    """Return the first and the end of a patch's rows or columns that lie within the image."""
    border = side + BEYOND
    return max(0, int(np.ceil(border - start))), max(0, min(side, int(size - border - start)))


@inner_kernel
def refine(
    target: Level,
    side: int,
    across: Row,
    down: Row,
    still: tuple[float, float],
    window: Row,
    corner: int,
    end: Points,
) -> bool:
    """Move the end of a patch until it matches the target; return whether it is found.

    Each step solves the normal equations of sum (target - patch + gradient . step)^2 over the
    patch, where `still` is sum patch gradient. The sum of target times gradient is bilinear between
    four pixels, so that the steps between the same pixels cost nothing. Steps that go back and
    forth end half way.
    """
    xx, xy, yy = dot(across, across), dot(across, down), dot(down, down)
    determinant = xx * yy - xy * xy
    least = (xx + yy - np.sqrt((xx - yy) ** 2 + 4 * xy * xy)) / 2
    if least < LEAST_GRADIENT**2 * side * side or determinant <= 0:
        return False
    u, v = float(end[0]) + corner, float(end[1]) + corner
    left = top = before_u = before_v = np.inf
    x_sums = y_sums = (0.0, 0.0, 0.0, 0.0)
    for _ in range(ITERATIONS):
        if not touches(target, side, u, v):
            break
        if left != np.floor(u) or top != np.floor(v):
            left, top = np.floor(u), np.floor(v)
            copy_patch(target, u, v, side + 1, side + 3, window)
            x_sums = corner_sums(window, across, side + 3)
            y_sums = corner_sums(window, down, side + 3)
        weights = corner_weights(u - left, v - top)
        x, y = weighted_sum(weights, x_sums) - still[0], weighted_sum(weights, y_sums) - still[1]
        step_u, step_v = (xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant
        u, v = u + step_u, v + step_v
        if step_u**2 + step_v**2 <= ACCURACY**2:
            break
        if abs(step_u + before_u) < ACCURACY and abs(step_v + before_v) < ACCURACY:
            u, v = u - step_u / 2, v - step_v / 2
            break
        before_u, before_v = step_u, step_v
    end[0], end[1] = u - corner, v - corner
    return touches(target, side, u, v)
