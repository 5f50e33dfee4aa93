"""Blob and corner features of an event image, in the manner of LIBVISO2.

Geiger, Ziegler and Stiller, "StereoScan: Dense 3d reconstruction in real-time", IV 2011.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.config import FeatureConfig

BLOB_MASK = np.array(
    [
        [-1, -1, -1, -1, -1],
        [-1, 1, 1, 1, -1],
        [-1, 1, 8, 1, -1],
        [-1, 1, 1, 1, -1],
        [-1, -1, -1, -1, -1],
    ],
    np.float32,
)
CORNER_MASK = np.outer([1, 1, 0, -1, -1], [1, 1, 0, -1, -1]).astype(np.float32)

SOBEL_SMOOTHING = np.array([1, 4, 6, 4, 1], np.float32)
SOBEL_DERIVATIVE = np.array([1, 2, 0, -2, -1], np.float32)

# Offsets (dx, dy) in pixels from a feature at which both gradients are sampled.
DESCRIPTOR_OFFSETS = np.array(
    [
        (sign_x * dx, sign_y * dy)
        for dx, dy in ((1, 1), (3, 1), (1, 5), (5, 3))
        for sign_x in (-1, 1)
        for sign_y in (-1, 1)
    ]
)
MARGIN = 6  # pixels at the border without features: the descriptor reaches 5


@dataclass(frozen=True, eq=False)
class Features(ArrayTable):
    """Features of one image at its own resolution.

    Attributes
    ----------
    points
        (N, 2) int32 pixel (u, v).
    kind
        (N,) int32: 0 minimum and 1 maximum of the blob response, 2 and 3 of the corner response.
    strength
        (N,) float32 response of the filter, relative to its largest possible response.
    descriptors
        (N, 32) uint8 gradients around the point, compared by their sum of absolute differences.
    """

    points: NDArray[np.int32]
    kind: NDArray[np.int32]
    strength: NDArray[np.float32]
    descriptors: NDArray[np.uint8]


def detect(image: NDArray[np.uint8], config: FeatureConfig) -> Features:
    """Find the extrema of the blob and the corner response of an 8-bit image and describe them."""
    points, kind, strength = extrema(image, config.nms_radius, config.response_threshold)
    return Features(points, kind, strength, describe(gradients(image), points))


def extrema(
    image: NDArray[np.uint8], nms_radius: int, threshold: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Find the points (N, 2), kinds (N,) and strengths (N,) of the extrema of both responses.

    The strength is the response of a filter, relative to its largest possible response.
    """
    found = []
    wide = image.astype(np.float32)
    for first_kind, mask in ((0, BLOB_MASK), (2, CORNER_MASK)):
        response = cv2.filter2D(wide, cv2.CV_32F, mask)
        largest = 255 * np.maximum(mask, 0).sum()
        for kind, signed in ((first_kind, -response), (first_kind + 1, response)):
            maxima = block_maxima(signed, nms_radius, threshold, MARGIN)
            strength = signed[maxima[:, 1], maxima[:, 0]] / largest
            found.append((maxima, np.full(len(maxima), kind, np.int32), strength))
    points, kinds, strengths = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(kinds), np.concatenate(strengths)


def strongest_spaced(
    points: NDArray[np.int32],
    strength: NDArray[np.float32],
    taken: NDArray[np.float32],
    spacing: int,
    count: int,
) -> NDArray[np.int64]:
    """Return the indices of the strongest points `spacing` pixels from each other and from `taken`.

    The distance is the larger one of the distances in columns and rows. At most `count` indices are
    returned, the strongest first.
    """
    order = np.argsort(-strength, kind="stable")
    everything = np.concatenate([np.rint(taken).astype(np.int32), points[order]])
    kept = _greedy_spacing(everything, len(taken), spacing, count)
    return order[kept]


@njit(cache=True)
def _greedy_spacing(
    points: NDArray[np.int32], taken: int, spacing: int, count: int
) -> NDArray[np.int64]:
    if len(points) == 0:
        return np.empty(0, np.int64)
    reach = spacing - 1
    width, height = points[:, 0].max() + spacing + 1, points[:, 1].max() + spacing + 1
    occupied = np.zeros((height, width), np.bool_)
    kept = np.empty(max(0, count), np.int64)
    number = 0
    for i in range(len(points)):
        u, v = points[i]
        if i >= taken:
            if number >= count:
                break
            if occupied[v, u]:
                continue
            kept[number] = i - taken
            number += 1
        occupied[max(0, v - reach) : v + reach + 1, max(0, u - reach) : u + reach + 1] = True
    return kept[:number]


def block_maxima(
    response: NDArray[np.float32], radius: int, threshold: float, margin: int
) -> NDArray[np.int32]:
    """Find local maxima (N, 2) by block non-maximum suppression (Neubeck and Van Gool, ICPR 2006).

    Each block of radius + 1 pixels has one candidate. It stays if nothing within the radius exceeds
    it.
    """
    height, width = response.shape
    if min(height, width) <= 2 * (radius + margin):
        return np.empty((0, 2), np.int32)
    inner = response[margin : height - margin, margin : width - margin]
    around = cv2.dilate(inner, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return _block_maxima(inner, around, radius, threshold) + np.int32(margin)


@njit(cache=True, nogil=True)
def _block_maxima(
    response: NDArray[np.float32], around: NDArray[np.float32], radius: int, threshold: float
) -> NDArray[np.int32]:
    """Find the first pixel (N, 2) of each block that equals the maximum around it."""
    side = radius + 1
    rows = -(-(response.shape[0] - 2 * radius) // side)
    columns = -(-(response.shape[1] - 2 * radius) // side)
    full = np.zeros((rows, columns), np.bool_)
    found = np.empty((full.size, 2), np.int32)
    count, least = 0, np.float32(threshold)
    for v in range(radius, radius + rows * side):
        for u in range(radius, radius + columns * side):
            # One condition for both: two would be mispredicted at every other pixel.
            if response[v, u] < max(least, around[v, u]):
                continue
            block = (v - radius) // side, (u - radius) // side
            if not full[block]:
                full[block] = True
                found[count] = u, v
                count += 1
    return found[:count].copy()


def gradients(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Compute the horizontal and vertical 5 x 5 Sobel response (height, width, 2) in 0..255."""
    source = image.astype(np.float32)
    return np.stack(
        [
            _as_bytes(cv2.sepFilter2D(source, cv2.CV_32F, SOBEL_DERIVATIVE, SOBEL_SMOOTHING)),
            _as_bytes(cv2.sepFilter2D(source, cv2.CV_32F, SOBEL_SMOOTHING, SOBEL_DERIVATIVE)),
        ],
        axis=-1,
    )


def _as_bytes(gradient: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.clip((gradient.astype(np.int32) >> 7) + 128, 0, 255).astype(np.uint8)


def describe(gradient: NDArray[np.uint8], points: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Compute the descriptors (N, 32) of points (N, 2) from the gradients of their image."""
    columns = points[:, 0, None] + DESCRIPTOR_OFFSETS[:, 0]
    rows = points[:, 1, None] + DESCRIPTOR_OFFSETS[:, 1]
    return gradient[rows, columns].reshape(len(points), 2 * len(DESCRIPTOR_OFFSETS))


def half_resolution(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Compute the mean of every 2 x 2 block, rounded down."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    wide = image[:height, :width].astype(np.uint16)
    return ((wide[::2, ::2] + wide[::2, 1::2] + wide[1::2, ::2] + wide[1::2, 1::2]) // 4).astype(
        np.uint8
    )


def smooth(image: NDArray[np.uint8], deviation: float) -> NDArray[np.uint8]:
    """Blur a binary frame by a Gaussian and brighten it.

    Brightening keeps the contrast of thin contours.
    """
    blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), deviation)
    blurred *= np.float32(1.5 * deviation)
    return np.minimum(blurred, np.float32(255), out=blurred).astype(np.uint8)
