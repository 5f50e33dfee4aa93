"""The image motion that makes a cluster's picture sharpest, where no features tell it.

Events that are moved back along their own motion fall on few pixels: the mean number of others on
an event's pixel is largest then (contrast maximisation: Gallego, Rebecq and Scaramuzza, "A unifying
contrast maximization framework for event cameras", 2018). The motion is constant in a tile of the
image; ON and OFF events are counted apart, as different contours make them.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from factors.kernels.compiled import kernel
from gpvo.events import ClusterEvents
from gpvo.tracking.event_sums import CELL, Flow

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TILES = 3, 4
"""Rows and columns of tiles."""
OVERLAP = 1.5
"""Sides of the parts of the image that are looked at, in those of the tiles."""
MANY = 20_000
"""Number of events of a cluster that are enough, taken evenly."""
FEW = 150
"""Number of events of a tile below which it has its neighbours' motion."""
FAR = 32
"""Longest way during a cluster that is searched, along u and v, pixels."""
STEPS = 4, 2, 1
"""Sides of the pixels in which events are counted, and steps of the ways that are compared."""
SHARPER = 1.05
"""Times as sharp as without motion from which a tile moves."""
SHORTER = 0.003
"""Share of the sharpness that a pixel of way costs: along straight contours all are as sharp."""


def sharpest_flow(events: ClusterEvents, start: float, stop: float, side: int) -> Flow | None:
    """Find the image motion of the events in [start, stop) that makes their picture sharpest.

    It is in pixels that are `side` pixels of the sensor wide. None if there are too few events.
    """
    size, some = np.array(events.resolution) // side, _some_of(events, start, stop, side)
    ways = np.full((*TILES, 2), np.nan)
    for row, column in np.ndindex(*TILES):
        ways[row, column] = _way_in_tile(np.array([column, row]), size, *some)
    known = np.isfinite(ways[..., 0])
    if not known.any():
        return None
    ways[~known] = np.median(ways[known], axis=0)
    smooth = median_filter(ways, size=(3, 3, 1), mode="nearest") / (stop - start)
    cells = -(-size // CELL)
    return np.asarray(cv2.resize(smooth.astype(np.float32), cells.tolist()), np.float32)


def _some_of(
    events: ClusterEvents, start: float, stop: float, side: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return pixels (N, 2), times (N,) from -1/2 to 1/2 in the cluster, and polarities (N,)."""
    some = events.events[:: max(1, events.event_count // MANY)]
    points = (events.table[some.y, some.x].astype(np.float64) - (side - 1) / 2) / side
    times = (some.t - 0.5 * (start + stop)) / (stop - start)
    inside = np.isfinite(points).all(axis=1)
    return points[inside], times[inside], some.polarity[inside]


def _way_in_tile(
    place: Index, size: Index, points: Array, times: Array, is_on: NDArray[np.bool_]
) -> Array:
    """Find the way (2,) of the events in and around a tile during the cluster; NaN if few.

    It is the one at column and row `place` (2,) of an image of the width and height `size` (2,).
    """
    tile = size / TILES[::-1]
    middle, half = (place + 0.5) * tile, 0.5 * OVERLAP * tile
    first, end = np.maximum(middle - half, 0), np.minimum(middle + half, size)
    inside = ((points >= first) & (points < end)).all(axis=1)
    if np.count_nonzero(inside) < FEW:
        return np.full(2, np.nan)
    seen = np.ceil(end - first).astype(np.int64)
    return sharpest_way_kernel(points[inside] - first, times[inside], is_on[inside], seen)


@kernel
def sharpest_way_kernel(
    points: Array, times: Array, is_on: NDArray[np.bool_], size: Index
) -> Array:
    """Find the way (2,) in one unit of time along which events make the sharpest picture.

    They are at points (N, 2) and times (N,), and seen inside of a `size` (2,) = (width, height). It
    is zero if no other one is SHARPER.
    """
    counts = np.zeros((2, size[1] + 1, size[0] + 1), np.int32)
    way, reach = np.zeros(2), FAR // STEPS[0]
    for step in STEPS:
        u, v = way
        best = -1.0
        for i in range(-reach, reach + 1):
            for j in range(-reach, reach + 1):
                along, down = u + step * i, v + step * j
                sharp = sharpness_kernel(points, times, is_on, along, down, step, size, counts)
                sharp *= 1 - SHORTER * np.hypot(along, down)
                if sharp > best:
                    best, way[0], way[1] = sharp, along, down
        reach = 2
    still = sharpness_kernel(points, times, is_on, 0.0, 0.0, STEPS[-1], size, counts)
    moved = sharpness_kernel(points, times, is_on, way[0], way[1], STEPS[-1], size, counts)
    return way if moved > SHARPER * still else np.zeros(2)


@kernel
def sharpness_kernel(
    points: Array,
    times: Array,
    is_on: NDArray[np.bool_],
    along: float,
    down: float,
    side: int,
    size: Index,
    counts: NDArray[np.int32],
) -> float:
    """Compute the mean number of others on an event's pixel, if moved back along (along, down).

    Pixels are `side` wide; `counts` (2, height + 1, width + 1) is used to count.
    """
    rows, columns = size[1] // side + 1, size[0] // side + 1
    counts[:, :rows, :columns] = 0
    inside, others = 0, 0
    for i in range(len(points)):
        u, v = points[i, 0] - along * times[i], points[i, 1] - down * times[i]
        if 0 <= u < size[0] and 0 <= v < size[1]:
            polarity, row, column = np.intp(is_on[i]), int(v) // side, int(u) // side
            others += 2 * counts[polarity, row, column]
            counts[polarity, row, column] += 1
            inside += 1
    return others / max(inside, 1)
