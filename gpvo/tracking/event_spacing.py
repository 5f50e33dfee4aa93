"""How far contours move between two events of a pixel: the contrast threshold over the gradient.

A pixel that sees a slope of brightness pass has an event each time it has changed by the threshold
C: from one to the next of the same polarity the slope moves by C / |gradient|.

Where a picture moves farther, more of its weak contours are seen, whose events are farther apart.
Between the slow and the fast places of four recordings, of two simulators, the median way grows
with the power 0.4 to 0.8 of the way that is shown there, in a fifth with 1.4; its root is taken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.events import ClusterEvents
from gpvo.tracking.event_sums import Flow, motion_at

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FARTHEST = 4.0
"""Way from which on two events are those of different contours, pixels."""
ENOUGH = 20_000
"""Number of a cluster's events that are looked at, about: those of every so many rows."""
FEWEST = 30
"""Number of pairs of events that tell the spacing."""
MEMORY = 16
"""Number of clusters over which it is averaged."""
NONE = 2
"""Instead of the polarity of a pixel's last event, if it had none."""


class EventSpacing:
    """Way of contours between two events of a pixel, where a cluster shows a way of one pixel.

    Pixels are `side` of the sensor's pixels wide.

    Attributes
    ----------
    value
        Median way, pixels; 0 while it is unknown.
    """

    def __init__(self, side: int) -> None:
        self._side, self.value = side, 0.0

    def follow(self, events: ClusterEvents, flow: Flow, duration: float) -> None:
        """Learn it from the events of a cluster of a duration, seconds, and its image motion."""
        pixel, interval = repeated_events(events)
        place = events.table[pixel[:, 1], pixel[:, 0]].astype(np.float64)
        known = np.isfinite(place).all(axis=1)  # a table may hold NaN
        place, interval = place[known], interval[known]
        speed = np.linalg.norm(motion_at(flow, (place + 0.5) / self._side - 0.5), axis=1)
        near = (speed > 0) & (speed * interval < FARTHEST)
        if np.count_nonzero(near) >= FEWEST:
            ways = speed[near] * interval[near] / np.sqrt(speed[near] * duration)
            share = 1 / MEMORY if self.value > 0 else 1.0
            self.value += share * (float(np.median(ways)) - self.value)


def rows_apart(events: ClusterEvents) -> int:
    """Return every how many rows have about ENOUGH events; 1 if all have no more."""
    return max(1, events.event_count // ENOUGH)


def repeated_events(events: ClusterEvents) -> tuple[Index, Array]:
    """Find events whose pixel had one of the same polarity before, and none of the other since.

    Returns their raw pixels (N, 2), and how long before it was (N,), seconds. Of many events those
    of every so many rows are taken.
    """
    shape, rows = events.table.shape[:2], rows_apart(events)
    last = np.zeros(shape), np.full(shape, NONE, np.uint8)
    found = [_repeated_kernel(e.x, e.y, e.t, e.polarity, rows, *last) for e in events.parts]
    pixels, intervals = [np.empty((0, 2), np.int64)], [np.empty(0)]
    return (
        np.concatenate(pixels + [pixel for pixel, _ in found]),
        np.concatenate(intervals + [interval for _, interval in found]),
    )


@kernel
def _repeated_kernel(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: Array,
    polarity: NDArray[np.bool_],
    rows: int,
    last: Array,
    sign: NDArray[np.uint8],
) -> tuple[Index, Array]:
    """Compare events with the time and the sign of their pixels' last ones, and set those."""
    pixels, intervals, count = np.empty((len(t), 2), np.int64), np.empty(len(t)), 0
    for i in range(len(t)):
        if y[i] % rows:
            continue
        now = np.uint8(polarity[i])
        if sign[y[i], x[i]] == now:
            pixels[count, 0], pixels[count, 1] = x[i], y[i]
            intervals[count] = t[i] - last[y[i], x[i]]
            count += 1
        sign[y[i], x[i]], last[y[i], x[i]] = now, t[i]
    return pixels[:count], intervals[:count]
