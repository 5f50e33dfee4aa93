"""Kernels of anchors: patches that are cut out, warped, and matched whatever their contrast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import fast_kernel, kernel
from gpvo.tracking.klt.lucas_kanade import BEYOND, refine, touches
from gpvo.tracking.klt.patch_kernels import (
    Level,
    Row,
    centre,
    differentiate,
    dot,
    relative_contrast,
    sample_centred,
)

Array = NDArray[np.float64]
Patches = NDArray[np.uint8]
Points = NDArray[np.float32]


@kernel
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
                patches[i, row, column] = line[min(max(left + column, 0), width - 1)]
    return patches


@kernel
def match_anchors_kernel(
    patches: Patches,
    places: Array,
    warps: Array,
    image: Level,
    side: int,
    ends: Points,
    alike: Array,
    searched: NDArray[np.bool_],
) -> None:
    """Refine the ends (N, 2), and set the correlation (N,) of those that are found.

    Only those are that are marked to be searched (N,).

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
    for i in np.flatnonzero(searched):
        u, v = float(ends[i, 0]) + corner, float(ends[i, 1]) + corner
        if not touches(image, side, u, v):
            continue
        warp_kernel(patches[i], places[i], warps[i], side, width, samples)
        differentiate(samples, width, across, down)
        centre(samples[width + 1 :], side, width, patch)
        sample_centred(image, u, v, side, width, window, seen, image_patch)
        gain = relative_contrast(patch, image_patch)
        for gradient in (across, down):
            centre(gradient, side, width, gradient)
            remove(patch, gain, gradient)
        if refine(image, side, across, down, (0.0, 0.0), window, corner, ends[i]):
            u, v = float(ends[i, 0]) + corner, float(ends[i, 1]) + corner
            sample_centred(image, u, v, side, width, window, seen, image_patch)
            contrast = dot(patch, patch) * dot(image_patch, image_patch)
            alike[i] = dot(patch, image_patch) / np.sqrt(contrast) if contrast > 0 else -1.0


@kernel
def warp_patches_kernel(
    patches: Patches, places: Array, warps: Array, side: int
) -> NDArray[np.float32]:
    """Sample kept patches (N, side, side) around places (N, 2) in them under their warps."""
    width = side + 3
    warped = np.empty((len(patches), side, side), np.float32)
    samples = np.zeros((side + 3) * width + 2, np.float32)
    for i in range(len(patches)):
        warp_kernel(patches[i], places[i], warps[i], side, width, samples)
        for row in range(side):
            start = (row + 1) * width + 1
            for k in range(side):  # a slice would compile for seconds
                warped[i, row, k] = samples[start + k]
    return warped


@fast_kernel
def warp_kernel(
    patch: NDArray[np.uint8], place: Array, warp: Array, side: int, width: int, samples: Row
) -> None:
    """Sample a kept patch at the pixels of the image, and of a margin of one around them.

    From the image back the warp is dp = q / (1 - h q) with q = J^-1 dp'.
    A row's places are computed before its samples are read, so that either loop is a vector's.
    """
    x_0, y_0, last = np.float32(place[0]), np.float32(place[1]), np.float32(len(patch) - 1.001)
    half, nothing, one, columns = side // 2 + 1, np.float32(0), np.float32(1), len(patch)
    area = warp[0, 0] * warp[1, 1] - warp[0, 1] * warp[1, 0]
    a, b = np.float32(warp[1, 1] / area), np.float32(-warp[0, 1] / area)
    c, d = np.float32(-warp[1, 0] / area), np.float32(warp[0, 0] / area)
    g, h = np.float32(warp[2, 0]), np.float32(warp[2, 1])
    pixels, start = patch.ravel().astype(np.float32), np.empty(side + 2, np.int32)
    beside, below, both = pixels[1:], pixels[columns:], pixels[columns + 1 :]
    right, low = np.empty(side + 2, np.float32), np.empty(side + 2, np.float32)
    for row in range(side + 2):
        y, line = np.float32(row - half), samples[row * width : row * width + side + 2]
        for k in range(side + 2):
            x = np.float32(np.int32(k) - np.int32(half))
            across, down = b * y + a * x, d * y + c * x
            nearer = one / (one - g * across - h * down)
            u = min(max(x_0 + nearer * across, nothing), last)
            v = min(max(y_0 + nearer * down, nothing), last)
            left, top = np.int32(u), np.int32(v)
            right[k], low[k] = u - np.float32(left), v - np.float32(top)
            start[k] = top * np.int32(columns) + left
        for k in range(side + 2):
            i = np.uint64(start[k])  # no negative indices
            upper = pixels[i] + right[k] * (beside[i] - pixels[i])
            lower = below[i] + right[k] * (both[i] - below[i])
            line[k] = upper + low[k] * (lower - upper)


@fast_kernel
def remove(patch: Row, gain: float, gradient: Row) -> None:
    """Remove what a gradient has of a patch, and scale the rest by a gain."""
    share = np.float32(dot(gradient, patch) / max(dot(patch, patch), 1e-9))
    scale = np.float32(gain)
    for k in range(len(gradient)):
        gradient[k] = scale * (gradient[k] - share * patch[k])
