"""Filters of single events before clustering: background activity and hot pixels."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.config import ClusteringConfig
from gpvo.recordings import Events

LEAST_HOT = 20
"""Number of events up to which a pixel is never judged hot."""


class EventFilter:
    """Noise filter of one camera, which remembers its pixels between batches.

    The filter of background activity is that of Delbruck, "Frame-free dynamic digital vision",
    2008.
    """

    def __init__(self, resolution: tuple[int, int], config: ClusteringConfig) -> None:
        width, height = resolution
        # A border of one pixel, so that every pixel has eight neighbours.
        self._latest = np.full((height + 2, width + 2), -np.inf)
        self._count = np.zeros((height + 2, width + 2))
        self._background = config.background_filter
        self._hot = config.hot_pixel_ratio

    def __call__(self, events: Events) -> Events:
        """Return the events that are not noise."""
        if self._background == 0 and self._hot == 0:
            return events
        keep = np.empty(len(events), np.bool_)
        _judge(
            events.x,
            events.y,
            events.t,
            self._latest,
            self._count,
            self._background,
            self._hot,
            keep,
        )
        return events[keep]


@njit(cache=True, nogil=True)
def _judge(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.float64],
    latest: NDArray[np.float64],
    count: NDArray[np.float64],
    background: float,
    hot: float,
    keep: NDArray[np.bool_],
) -> None:
    for i in range(len(t)):
        row, column = int(y[i]) + 1, int(x[i]) + 1
        newest, around = -np.inf, 0.0
        for v in range(row - 1, row + 2):
            for u in range(column - 1, column + 2):
                if v != row or u != column:
                    newest = max(newest, latest[v, u])
                    around += count[v, u]
        latest[row, column] = t[i]
        count[row, column] += 1
        keep[i] = background == 0 or t[i] - newest <= background
        if hot > 0 and count[row, column] > LEAST_HOT:
            keep[i] &= count[row, column] <= hot * (around / 8 + 1)
