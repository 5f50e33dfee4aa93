"""Stereo matching of a patch: a search along the row at the time of its left events."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.tracking.haste.event_rows import EventRows, events_around
from gpvo.tracking.haste.templates import align, draw

Array = NDArray[np.float64]


@njit(cache=True)
def match_right(
    left: Array,
    right: EventRows,
    position: Array,
    size: int,
    disparities: tuple[int, int],
    kernel: Array,
) -> tuple[Array, float, float, float]:
    """Match a left patch with the right events; return the right pixel (2,) and its quality.

    `left` (N, 3) are the events of the patch, and `position` (2,) is its left pixel. Disparities
    are searched from the first to the last one given. The quality is the mean time of the right
    events in seconds, the correlation of both patches, and the standard deviation of the pixel.
    """
    least, most = disparities
    half = 0.5 * size + len(kernel) // 2
    middle = np.array([position[0] - 0.5 * (least + most), position[1], 0.0])
    first, last = left[:, 2].min(), left[:, 2].max()
    around = (half + 0.5 * (most - least), half)
    seen = events_around(right, first, last, middle[:2], around)
    template = draw(left, np.array([position[0], position[1], 0.0]), (size, size), kernel)
    row = draw(seen, middle, (size, size + most - least), kernel)
    guess = np.array([position[0] - most + best_shift(row, template), position[1], 0.0])
    seen = seen[np.abs(seen[:, 0] - guess[0]) <= half]
    pose, likeness, deviation = align(seen, template, guess, kernel, 1)
    return pose[:2], mean_time(seen), likeness, deviation


@njit(cache=True)
def mean_time(events: Array) -> float:
    """Compute the mean time of events (N, 3), seconds; NaN if there are none."""
    return events[:, 2].mean() if len(events) else np.nan


@njit(cache=True)
def best_shift(row: Array, template: Array) -> int:
    """Find the column at which a strip of image (S, W) correlates best with a template (S, S)."""
    size = len(template)
    zero_mean = template - template.mean()
    best, best_value = 0, -np.inf
    column_sum, column_square = row.sum(axis=0), (row**2).sum(axis=0)
    for shift in range(row.shape[1] - size + 1):
        across = 0.0
        for r in range(size):
            for c in range(size):
                across += zero_mean[r, c] * row[r, shift + c]
        total = column_sum[shift : shift + size].sum()
        variance = column_square[shift : shift + size].sum() - total**2 / size**2
        value = across / np.sqrt(variance) if variance > 1e-9 else -np.inf
        if value > best_value:
            best, best_value = shift, value
    return best
