"""Kernels of anchors: patches that are cut out, warped, and matched whatever their contrast."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.tracking.klt.lucas_kanade import BEYOND, refine, touches
from gpvo.tracking.klt.patch_kernels import (
    FAST,
    Level,
    Row,
    copy_patch,
    differentiate,
    dot,
    interpolate,
)

Array = NDArray[np.float64]
Patches = NDArray[np.uint8]
Points = NDArray[np.float32]

LEAST_GAIN, MOST_GAIN = 0.2, 5.0
"""Contrast of an image, relative to that of a patch, with which a search begins."""


@njit(cache=True, nogil=True)
def cut_patches_kernel(image: Level, centres: NDArray[np.int64], border: int, half: int) -> Patches:
    """Copy the patches (N, 2 half + 1, 2 half + 1) around pixels (N, 2).

    The image has a border around it, beyond which its last pixels are repeated.
    """
    height, width = image.shape
    side = 2 * half + 1
    patches = np.empty((len(centres), side, side), np.uint8)
    for i in range(len(centres)):
        left, top = centres[i, 0] + border - half, centres[i, 1] + border - half
        for row in range(side):
            line = image[min(max(top + row, 0), height - 1)]
            for column in range(side):
                patches[i, row, column] = np.uint8(line[min(max(left + column, 0), width - 1)])
    return patches


@njit(cache=True, nogil=True)
def match_anchors_kernel(
    patches: Patches,
    places: Array,
    inverse_warps: Array,
    image: Level,
    side: int,
    ends: Points,
    alike: Array,
) -> None:
    """Refine the ends (N, 2), and set the correlation (N,) of those that are found.

    Landmarks are at the places (N, 2) of the patches, pixels from their first one.

    With gain g and bias b the image is g patch + b. The gradients are made orthogonal to the patch
    and to a constant, so that both drop out of the normal equations of a step.
    """
    width = side + 3  # of the rows of all patches, which are stored one after the other
    size = (side + 3) * width + 2
    rows, parts = np.zeros((3, size), np.float32), np.zeros((4, side * width), np.float32)
    window, samples, seen = rows[0], rows[1], rows[2]
    across, down, patch, image_patch = parts[0], parts[1], parts[2], parts[3]
    corner = side + BEYOND - side // 2  # from the centre of a patch to its first pixel
    for i in range(len(patches)):
        u, v = float(ends[i, 0]) + corner, float(ends[i, 1]) + corner
        if not touches(image, side, u, v):
            continue
        warp_kernel(patches[i], places[i], inverse_warps[i], side, width, samples)
        differentiate(samples, width, across, down)
        centre(samples[width + 1 :], side, width, patch)
        _sample(image, u, v, side, width, window, seen, image_patch)
        gain = dot(patch, image_patch) / max(dot(patch, patch), 1e-9)
        gain = min(max(gain, LEAST_GAIN), MOST_GAIN)
        for gradient in (across, down):
            centre(gradient, side, width, gradient)
            remove(patch, gain, gradient)
        if refine(image, side, across, down, (0.0, 0.0), window, corner, ends[i]):
            u, v = float(ends[i, 0]) + corner, float(ends[i, 1]) + corner
            _sample(image, u, v, side, width, window, seen, image_patch)
            contrast = dot(patch, patch) * dot(image_patch, image_patch)
            alike[i] = dot(patch, image_patch) / np.sqrt(contrast) if contrast > 0 else -1.0


@njit(cache=True, nogil=True)
def warp_patches_kernel(
    patches: Patches, places: Array, inverse_warps: Array, side: int
) -> NDArray[np.float32]:
    """Sample kept patches (N, side, side) around places (N, 2) in them under their warps."""
    width = side + 3
    warped = np.empty((len(patches), side, side), np.float32)
    samples = np.zeros((side + 3) * width + 2, np.float32)
    for i in range(len(patches)):
        warp_kernel(patches[i], places[i], inverse_warps[i], side, width, samples)
        for row in range(side):
            start = (row + 1) * width + 1
            warped[i, row] = samples[start : start + side]
    return warped


@njit(cache=True, nogil=True)
def warp_kernel(
    patch: NDArray[np.uint8], place: Array, inverse: Array, side: int, width: int, samples: Row
) -> None:
    """Sample a kept patch at the pixels of the image, and of a margin of one around them."""
    x_0, y_0, last = np.float32(place[0]), np.float32(place[1]), np.float32(len(patch) - 1.001)
    half, nothing = side // 2 + 1, np.float32(0)
    a, b = np.float32(inverse[0, 0]), np.float32(inverse[0, 1])
    c, d = np.float32(inverse[1, 0]), np.float32(inverse[1, 1])
    for row in range(side + 2):
        y = np.float32(row - half)
        for column in range(side + 2):
            x = np.float32(column - half)
            u = min(max(x_0 + a * x + b * y, nothing), last)
            v = min(max(y_0 + c * x + d * y, nothing), last)
            left, top = int(u), int(v)
            right, low = u - left, v - top
            upper = (1 - right) * patch[top, left] + right * patch[top, left + 1]
            lower = (1 - right) * patch[top + 1, left] + right * patch[top + 1, left + 1]
            samples[row * width + column] = (1 - low) * upper + low * lower


@njit(cache=True, nogil=True, fastmath=FAST)
def centre(values: Row, side: int, width: int, centred: Row) -> None:
    """Subtract the mean of a patch from its pixels, and clear what lies between its rows."""
    total = np.float32(0)
    for row in range(side):
        for k in range(row * width, row * width + side):
            total += values[k]
    mean = total / np.float32(side * side)
    for row in range(side):
        end = row * width + side
        for k in range(row * width, end):
            centred[k] = values[k] - mean
        centred[end : end + width - side] = 0


@njit(cache=True, nogil=True, fastmath=FAST)
def remove(patch: Row, gain: float, gradient: Row) -> None:
    """Remove what a gradient has of a patch, and scale the rest by a gain."""
    share = np.float32(dot(gradient, patch) / max(dot(patch, patch), 1e-9))
    scale = np.float32(gain)
    for k in range(len(gradient)):
        gradient[k] = scale * (gradient[k] - share * patch[k])


@njit(cache=True, nogil=True)
def _sample(
    image: Level, u: float, v: float, side: int, width: int, window: Row, seen: Row, centred: Row
) -> None:
    """Sample the patch of an image with its first pixel at (u, v), without its mean."""
    copy_patch(image, u, v, side + 1, width, window)
    interpolate(window, u - np.floor(u), v - np.floor(v), width, seen)
    centre(seen, side, width, centred)
