"""Kernels of motion-compensated images: image motion, sums of events, pictures, mean times."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import fast_kernel, kernel

Array = NDArray[np.float64]
Flow = NDArray[np.float32]
"""(rows, columns, 2) image motion in the middles of cells, pixels per second."""

Moved = NDArray[np.float32]
"""(N, 3) pixels (u, v) and delays of events, seconds."""

Sums = NDArray[np.float32]
"""(height, width, 2) number of events of each pixel, and sum of their delays, seconds."""

CELL = 8
"""Side of the cells of averaged image motion, pixels; motion is interpolated between cells."""
FINE = 4
"""Side of the cells whose events are moved alike, pixels: interpolating for each takes too long."""
TOGETHER = 256
"""Number of events that are rectified before they are moved, and moved before they are added."""
SQUARINGS = 6
"""Of the cubic of exp(-n / 2^6), which make exp(-n) to 0.001 grey levels, without branches."""


@kernel
def motion_at(flow: Flow, points: Array) -> Array:
    """Compute the image motion (N, 2) at points (N, 2), bilinear between the middles of cells."""
    motion = np.empty((len(points), 2))
    for i in range(len(points)):
        motion[i, 0], motion[i, 1] = _motion_at(flow, points[i, 0], points[i, 1])
    return motion


@kernel
def _motion_at(flow: Flow, u: float, v: float) -> tuple[float, float]:
    rows, columns, _ = flow.shape
    x = min(max((u + 0.5) / CELL - 0.5, 0.0), columns - 1.0)
    y = min(max((v + 0.5) / CELL - 0.5, 0.0), rows - 1.0)
    left, top = int(x), int(y)
    right, low = min(left + 1, columns - 1), min(top + 1, rows - 1)
    x, y = x - left, y - top
    a, b, c, d = (1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y
    upper, lower = flow[top], flow[low]
    return (
        a * upper[left, 0] + b * upper[right, 0] + c * lower[left, 0] + d * lower[right, 0],
        a * upper[left, 1] + b * upper[right, 1] + c * lower[left, 1] + d * lower[right, 1],
    )


def fine_flow(flow: Flow) -> Flow:
    """Interpolate image motion for the middles of FINE cells."""
    rows, columns, _ = flow.shape
    size = columns * CELL // FINE, rows * CELL // FINE
    return np.asarray(cv2.resize(flow, size, interpolation=cv2.INTER_LINEAR), np.float32)


@fast_kernel
def add_events(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: Array,
    every: int,
    table: NDArray[np.float32],
    side: int,
    reference: float,
    fine: Flow,
    sums: Sums,
) -> None:
    """Add events at raw pixels (x, y) to the four pixels around their positions at `reference`.

    Of each `every` events the first one is added.
    `table` (raw height, raw width, 2) holds the rectified pixels. Pixels of the sums are `side` of
    these wide. `fine` is the image motion of FINE cells, that of the last one beyond them. Where a
    table holds NaN, as some do, events are left out.
    """
    moved = np.empty((TOGETHER, 3), np.float32)
    for first in range(0, len(t), TOGETHER * every):
        events = x[first:], y[first:], t[first : first + TOGETHER * every]
        rectified = _rectify(*events, every, table, reference, moved)
        count = _move(moved[:rectified], side, fine, sums.shape)
        _add(moved[:count], sums)


@fast_kernel
def _rectify(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: Array,
    every: int,
    table: NDArray[np.float32],
    reference: float,
    moved: Moved,
) -> int:
    """Set the rectified pixels and delays of each first of `every` events; return their number.

    The table of a large sensor is beyond the processor's caches. It waits for many entries at once
    where it does nothing else meanwhile.
    """
    count = np.uint64(0)
    for i in range(0, len(t), every):
        place = table[np.uint64(y[i]), np.uint64(x[i])]
        moved[count, 0], moved[count, 1] = place[0], place[1]
        moved[count, 2] = np.float32(t[i] - reference)
        count += np.uint64(1)
    return int(count)


@fast_kernel
def _move(moved: Moved, side: int, fine: Flow, shape: tuple[int, int, int]) -> int:
    """Move events from rectified pixels to where they are at the reference time, in wider pixels.

    Those inside come first; return their number. Nothing depends on the event before, so that the
    processor works on several at once.
    """
    rows, columns, _ = fine.shape
    # 32 bits: these are converted in one step. Indices without a sign need no check for one.
    last_row, last_column = np.int32(rows - 1), np.int32(columns - 1)
    right_end, low_end = np.float32(shape[1] - 1), np.float32(shape[0] - 1)
    scale, shift = np.float32(1 / side), np.float32((side - 1) / (2 * side))
    half, nothing, count = np.float32(0.5), np.float32(0), np.uint64(0)
    for i in range(len(moved)):
        u, v = moved[i, 0] * scale - shift, moved[i, 1] * scale - shift
        inside = -half <= u < right_end + half and -half <= v < low_end + half
        u, v = u if inside else nothing, v if inside else nothing
        delay = moved[i, 2]
        row = min(np.int32(v + half) // np.int32(FINE), last_row)
        column = min(np.int32(u + half) // np.int32(FINE), last_column)
        motion = fine[np.uint64(row), np.uint64(column)]
        u, v = u - delay * motion[0], v - delay * motion[1]
        moved[count, 0], moved[count, 1], moved[count, 2] = u, v, delay
        count += np.uint64(inside and 0 <= u < right_end and 0 <= v < low_end)
    return int(count)


@fast_kernel
def _add(moved: Moved, sums: Sums) -> None:
    """Share events among the four pixels around them."""
    one = np.float32(1)
    for i in range(len(moved)):
        u, v, delay = moved[i]
        column, row = np.int32(u), np.int32(v)
        right, low = u - np.float32(column), v - np.float32(row)
        upper = sums[np.uint64(row), np.uint64(column) :]
        lower = sums[np.uint64(row + 1), np.uint64(column) :]
        _share(upper, (one - low) * (one - right), (one - low) * right, delay)
        _share(lower, low * (one - right), low * right, delay)


@fast_kernel
def _share(pixels: Sums, left: float, right: float, delay: float) -> None:
    """Add the shares of an event to two pixels side by side."""
    pixels[0, 0] += left
    pixels[0, 1] += left * delay
    pixels[1, 0] += right
    pixels[1, 1] += right * delay


@fast_kernel
def brightness(sums: Sums, weight: float) -> NDArray[np.uint8]:
    """Compute the picture 255 (1 - exp(-n)) of `weight` times as many events n as are summed."""
    picture, counts = np.empty(sums.shape[:2], np.uint8), sums.reshape(-1)
    pixels, part = picture.reshape(-1), np.float32(weight / 2**SQUARINGS)
    one, half, third, white = np.float32(1), np.float32(1 / 2), np.float32(1 / 3), np.float32(255)
    for k in range(len(pixels)):
        y = min(part * counts[2 * k], one)
        absent = one - y * (one - half * y * (one - third * y))
        for _ in range(SQUARINGS):
            absent *= absent
        pixels[k] = np.uint8(np.int32(white * (one - absent) + half))
    return picture


@kernel
def mean_delays(sums: Sums, points: Array, radius: float) -> Array:
    """Compute the mean delay (N,) of the events within a radius of points (N, 2); 0 if none."""
    height, width, _ = sums.shape
    means = np.zeros(len(points))
    for i in range(len(points)):
        u, v = points[i]
        events = total = 0.0
        for row in range(max(0, int(np.ceil(v - radius))), min(height - 1, int(v + radius)) + 1):
            half = np.sqrt(max(radius**2 - (row - v) ** 2, 0.0))
            first, last = max(0, int(np.ceil(u - half))), min(width - 1, int(u + half))
            in_row = _totals(sums[row, first : last + 1])
            events, total = events + in_row[0], total + in_row[1]
        means[i] = total / events if events > 0 else 0.0
    return means


@fast_kernel
def _totals(pixels: Sums) -> tuple[float, float]:
    """Sum both columns of some pixels, in an order that suits vector registers."""
    events = delays = np.float32(0)
    for k in range(len(pixels)):
        events += pixels[k, 0]
        delays += pixels[k, 1]
    return float(events), float(delays)
