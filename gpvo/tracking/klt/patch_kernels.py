"""Kernels of patches whose rows lie one after the other, so that their sums are single loops."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import fast_kernel, inner_kernel, kernel

Level = NDArray[np.uint8]
"""Image of a pyramid's level, with a border around it."""
Row = NDArray[np.float32]
"""Rows of a patch, one after the other."""
Corners = tuple[float, float, float, float]
"""Values at four pixels around a place: the first, right of it, below it, and both."""
LEAST_GAIN, MOST_GAIN = 0.2, 5.0
"""Contrast of an image, relative to that of a patch, with which it is compared."""


@kernel
def copy_patch(image: Level, u: float, v: float, rows: int, width: int, patch: Row) -> None:
    """Copy the pixels from (u, v), rounded down, on."""
    left, top, columns = np.uint64(u), np.uint64(v), np.uint64(width)  # no negative indices
    for row in range(np.uint64(rows)):
        for column in range(columns):
            patch[row * columns + column] = np.float32(image[top + row, left + column])


@fast_kernel
def interpolate(window: Row, x: float, y: float, width: int, samples: Row) -> None:
    """Sample a window at (x, y) from its pixels, bilinearly."""
    n = len(window) - width - 2
    weights = corner_weights(x, y)
    a, b = np.float32(weights[0]), np.float32(weights[1])
    c, d = np.float32(weights[2]), np.float32(weights[3])
    right, below, both = window[1:], window[width:], window[width + 1 :]
    for k in range(n):
        samples[k] = a * window[k] + b * right[k] + c * below[k] + d * both[k]


@kernel
def corner_weights(x: float, y: float) -> Corners:
    """Compute the weights of the four pixels around a place (x, y) from the first of them."""
    return (1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y


@kernel
def sample_patch(
    image: NDArray[Any], u: float, v: float, window: NDArray[Any], patch: NDArray[Any]
) -> None:
    """Sample a patch (side, side) around (u, v) bilinearly; the border's pixels are repeated.

    The window (side + 1, side + 1) is to work in.
    """
    height, width = image.shape
    side = len(patch)
    left, top = int(np.floor(u)), int(np.floor(v))
    for row in range(side + 1):
        line = image[min(max(top - side // 2 + row, 0), height - 1)]
        for column in range(side + 1):
            window[row, column] = line[min(max(left - side // 2 + column, 0), width - 1)]
    a, b, c, d = corner_weights(u - left, v - top)
    for row in range(side):
        upper, lower, samples = window[row], window[row + 1], patch[row]
        for k in range(side):
            samples[k] = a * upper[k] + b * upper[k + 1] + c * lower[k] + d * lower[k + 1]


@fast_kernel
def differentiate(samples: Row, width: int, across: Row, down: Row) -> None:
    """Compute the gradients of a patch after Scharr; samples have a margin of a pixel."""
    edge, middle = np.float32(3 / 32), np.float32(10 / 32)
    nw, n, ne = samples, samples[1:], samples[2:]
    w, e = samples[width:], samples[width + 2 :]
    sw, s, se = samples[2 * width :], samples[2 * width + 1 :], samples[2 * width + 2 :]
    for k in range(len(across)):
        across[k] = edge * (ne[k] - nw[k] + se[k] - sw[k]) + middle * (e[k] - w[k])
    for k in range(len(down)):
        down[k] = edge * (sw[k] - nw[k] + se[k] - ne[k]) + middle * (s[k] - n[k])


@kernel
def clear_outside(
    columns: tuple[int, int], rows: tuple[int, int], width: int, across: Row, down: Row
) -> None:
    """Clear gradients but those in the columns and rows of a patch, which end before (_, end)."""
    for row in range(len(across) // width):
        start = row * width
        left = columns[0] if rows[0] <= row < rows[1] else width
        for k in range(start, start + left):
            across[k] = down[k] = 0
        for k in range(start + columns[1], start + width):
            across[k] = down[k] = 0


@fast_kernel
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


@inner_kernel
def sample_gradients(
    image: Level,
    u: float,
    v: float,
    side: int,
    width: int,
    window: Row,
    samples: Row,
    across: Row,
    down: Row,
) -> None:
    """Sample the patch of an image with its first pixel at (u, v), with a margin of a pixel."""
    copy_patch(image, u - 1, v - 1, side + 3, width, window)
    interpolate(window, u - np.floor(u), v - np.floor(v), width, samples)
    differentiate(samples, width, across, down)


@inner_kernel
def sample_centred(
    image: Level, u: float, v: float, side: int, width: int, window: Row, seen: Row, centred: Row
) -> None:
    """Sample the patch of an image with its first pixel at (u, v), without its mean."""
    copy_patch(image, u, v, side + 1, width, window)
    interpolate(window, u - np.floor(u), v - np.floor(v), width, seen)
    centre(seen, side, width, centred)


@fast_kernel
def dot(a: Row, b: Row) -> float:
    total = np.float32(0)
    for k in range(len(b)):
        total += a[k] * b[k]
    return float(total)


@inner_kernel
def relative_contrast(patch: Row, other: Row) -> float:
    """Compute the contrast of another patch relative to one, both without their means."""
    gain = dot(patch, other) / max(dot(patch, patch), 1e-9)
    return min(max(gain, LEAST_GAIN), MOST_GAIN)


@fast_kernel
def corner_sums(window: Row, gradient: Row, width: int) -> Corners:
    """Sum the products of a gradient with the window, a pixel to the right, below, and both."""
    right, below, both = window[1:], window[width:], window[width + 1 :]
    a = b = c = d = np.float32(0)
    for k in range(len(gradient)):
        a += window[k] * gradient[k]
        b += right[k] * gradient[k]
        c += below[k] * gradient[k]
        d += both[k] * gradient[k]
    return float(a), float(b), float(c), float(d)


@kernel
def weighted_sum(weights: Corners, values: Corners) -> float:
    return (
        weights[0] * values[0]
        + weights[1] * values[1]
        + weights[2] * values[2]
        + weights[3] * values[3]
    )
