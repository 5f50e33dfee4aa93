"""Latest events of a camera, sorted so that those near a point are found quickly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class EventRows(NamedTuple):
    """Table of E events, sorted by row.

    Attributes
    ----------
    events
        (E, 3) u, v and time; row by row, in order of time within a row.
    start
        (height + 1,) index of the first event of every row, then E.
    """

    events: Array
    start: NDArray[np.int64]


@njit(cache=True)
def event_rows(events: Array, height: int) -> EventRows:
    """Sort events (E, 3), given in order of time, by row; drop those outside the image."""
    count = np.zeros(height + 1, np.int64)
    for i in range(len(events)):
        row = int(np.rint(events[i, 1]))
        if 0 <= row < height:
            count[row + 1] += 1
    start = np.cumsum(count)
    ordered, place = np.empty((start[-1], 3)), start[:-1].copy()
    for i in range(len(events)):
        row = int(np.rint(events[i, 1]))
        if 0 <= row < height:
            ordered[place[row]] = events[i]
            place[row] += 1
    return EventRows(ordered, start)


@njit(cache=True)
def events_around(
    rows: EventRows, first: float, last: float, centre: Array, half: tuple[float, float]
) -> Array:
    """Return the events (N, 3) of a time interval in a rectangle around a point.

    The interval is from time `first` to `last`. The rectangle has the half sizes (u, v) `half`
    around the point `centre` (2,).
    """
    low = max(0, int(np.floor(centre[1] - half[1])))
    high = min(len(rows.start) - 1, int(np.ceil(centre[1] + half[1])) + 1)
    if high <= low:
        return np.empty((0, 3))
    found, count = np.empty((rows.start[high] - rows.start[low], 3)), 0
    for row in range(low, high):
        events = rows.events[rows.start[row] : rows.start[row + 1]]
        for i in range(np.searchsorted(events[:, 2], first), len(events)):
            if events[i, 2] > last:
                break
            near = abs(events[i, 0] - centre[0]) <= half[0]
            if near and abs(events[i, 1] - centre[1]) <= half[1]:
                found[count] = events[i]
                count += 1
    return found[:count]


def latest_around(rows: EventRows, centre: Array, half: float, most: int) -> Array:
    """Return the latest events (N, 3) around a point (2,), in order of time.

    At most `most` events are returned, within `half` pixels of the point along both axes.
    """
    found = events_around(rows, -np.inf, np.inf, centre, (half, half))
    return found[np.argsort(found[:, 2], kind="stable")[-most:]]
