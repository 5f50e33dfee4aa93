"""Kernels of motion-compensated images: image motion at a place, sums of events, mean times."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flow = NDArray[np.float32]
"""(rows, columns, 2) image motion in the middles of cells, pixels per second."""

Sums = NDArray[np.float32]
"""(height, width, 2) number of events of each pixel, and sum of their delays, seconds."""

CELL = 8
"""Side of the cells of averaged image motion, pixels; motion is interpolated between cells."""


@njit(cache=True, nogil=True)
def motion_at(flow: Flow, points: Array) -> Array:
    """Compute the image motion (N, 2) at points (N, 2), bilinear between the middles of cells."""
    motion = np.empty((len(points), 2))
    for i in range(len(points)):
        motion[i] = _motion_at(flow, points[i, 0], points[i, 1])
    return motion


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def add_events(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: Array,
    table: NDArray[np.float32],
    side: float,
    reference: float,
    flow: Flow,
    sums: Sums,
) -> None:
    """Add events at raw pixels (x, y) to the four pixels around their positions at `reference`.

    `table` (raw height, raw width, 2) holds the rectified pixels. Pixels of the sums are `side` of
    these wide. Where a table holds NaN, as some do, events are left out.
    """
    height, width, _ = sums.shape
    shift = (side - 1) / 2
    for i in range(len(t)):
        u, v = (table[y[i], x[i], 0] - shift) / side, (table[y[i], x[i], 1] - shift) / side
        if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
            continue
        delay = t[i] - reference
        motion = _motion_at(flow, u, v)
        u, v = u - delay * motion[0], v - delay * motion[1]
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        column, row = int(u), int(v)
        right, low = u - column, v - row
        for line, share in ((row, 1 - low), (row + 1, low)):
            sums[line, column, 0] += share * (1 - right)
            sums[line, column, 1] += share * (1 - right) * delay
            sums[line, column + 1, 0] += share * right
            sums[line, column + 1, 1] += share * right * delay


@njit(cache=True, nogil=True)
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
            for column in range(first, last + 1):
                events += sums[row, column, 0]
                total += sums[row, column, 1]
        means[i] = total / events if events > 0 else 0.0
    return means
