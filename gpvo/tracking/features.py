"""Blob and corner features of an event image, in the manner of LIBVISO2.

Geiger, Ziegler and Stiller, "StereoScan: Dense 3d reconstruction in real-time", IV 2011.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.array_table import ArrayTable
from gpvo.config import FeatureConfig
from gpvo.tracking.responses import LARGEST_BLOB, LARGEST_CORNER, blob_and_corner

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
    points, kind, response = extrema(image, config.nms_radius, config.response_threshold)
    strength = np.divide(response, LARGEST_BLOB, dtype=np.float32)
    return Features(points, kind, strength, describe(gradients(image), points))


def extrema(
    image: NDArray[np.uint8], nms_radius: int, threshold: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int16]]:
    """Find the points (N, 2), kinds (N,) and responses (N,) of the extrema of both filters.

    The response of the corner filter counts twice, so that both have the same largest one.
    """
    found = []
    blob, corner = blob_and_corner(image)
    for first_kind, response, largest in ((0, blob, LARGEST_BLOB), (2, corner, LARGEST_CORNER)):
        for kind, signed in ((first_kind, -response), (first_kind + 1, response)):
            maxima = block_maxima(signed, nms_radius, ceil(threshold), MARGIN)
            height = signed[maxima[:, 1], maxima[:, 0]] * np.int16(LARGEST_BLOB // largest)
            found.append((maxima, np.full(len(maxima), kind, np.int32), height))
    points, kinds, heights = zip(*found, strict=True)
    return np.concatenate(points), np.concatenate(kinds), np.concatenate(heights)


@dataclass(frozen=True)
class Crowd:
    """Limit of the number of features in each part of an image.

    Attributes
    ----------
    width, height
        Of a part, pixels.
    most
        Number of features in it.
    """

    width: int
    height: int
    most: int


ANY = Crowd(2**31, 2**31, 2**31)
"""No limit."""


def strongest_spaced(
    points: NDArray[np.int32],
    strength: NDArray[np.float32] | NDArray[np.int16],
    taken: NDArray[np.float32],
    spacing: int,
    count: int,
    crowd: Crowd = ANY,
) -> NDArray[np.int64]:
    """Return the indices of the strongest points `spacing` pixels from each other and from `taken`.

    The distance is the larger one of the distances in columns and rows. At most `count` indices are
    returned, the strongest first, and none in parts of the image that are full.
    """
    order = np.argsort(-strength, kind="stable")
    everything = np.concatenate([np.rint(taken).astype(np.int32), points[order]])
    limits = crowd.width, crowd.height, crowd.most
    return order[_greedy_spacing(everything, len(taken), spacing, count, limits)]


@kernel
def _greedy_spacing(
    points: NDArray[np.int32], taken: int, spacing: int, count: int, crowd: tuple[int, int, int]
) -> NDArray[np.int64]:
    if len(points) == 0:
        return np.empty(0, np.int64)
    reach = spacing - 1
    width, height = points[:, 0].max() + 1, points[:, 1].max() + 1
    occupied = np.zeros((height, width), np.bool_)
    numbers = np.zeros((height // crowd[1] + 1, width // crowd[0] + 1), np.int64)
    kept = np.empty(max(0, count), np.int64)
    number = 0
    for i in range(len(points)):
        u, v = points[i]
        part = v // crowd[1], u // crowd[0]
        if i >= taken:
            if number >= count:
                break
            if occupied[v, u] or numbers[part] >= crowd[2]:
                continue
            kept[number] = i - taken
            number += 1
        occupied[max(0, v - reach) : v + reach + 1, max(0, u - reach) : u + reach + 1] = True
        numbers[part] += 1
    return kept[:number]


def are_near(
    points: NDArray[np.floating], others: NDArray[np.float32], distance: float
) -> NDArray[np.bool_]:
    """Tell which points (N, 2) have another one (M, 2) within a distance."""
    return np.asarray(_are_near_kernel(points.astype(np.float64), others, distance))


@kernel
def _are_near_kernel(
    points: NDArray[np.float64], others: NDArray[np.float32], distance: float
) -> NDArray[np.bool_]:
    near = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        for k in range(len(others)):
            u, v = points[i, 0] - others[k, 0], points[i, 1] - others[k, 1]
            if u * u + v * v < distance * distance:
                near[i] = True
                break
    return near


def block_maxima(
    response: NDArray[np.int16], radius: int, threshold: float, margin: int
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
    peaks = np.flatnonzero((inner == around) & (inner >= threshold))
    return _first_of_blocks(peaks, inner.shape, radius) + np.int32(margin)


@kernel
def _first_of_blocks(
    peaks: NDArray[np.int64], shape: tuple[int, int], radius: int
) -> NDArray[np.int32]:
    """Return the first pixel (N, 2) of each block among the peaks, places in rows joined to one."""
    height, width = shape
    side = radius + 1
    rows, columns = -(-(height - 2 * radius) // side), -(-(width - 2 * radius) // side)
    full = np.zeros((rows, columns), np.bool_)
    found = np.empty((min(len(peaks), full.size), 2), np.int32)
    count = 0
    for peak in peaks:
        v, u = peak // width - radius, peak % width - radius
        block = v // side, u // side
        inside = 0 <= v < rows * side and 0 <= u < columns * side
        if inside and not full[block]:
            full[block] = True
            found[count, 0], found[count, 1] = u + radius, v + radius
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

    Brightening keeps the contrast of thin contours. A small blur leaves them, and is not darkened.
    """
    blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), deviation)
    blurred *= np.float32(max(1.0, 1.5 * deviation))
    return np.minimum(blurred, np.float32(255), out=blurred).astype(np.uint8)
