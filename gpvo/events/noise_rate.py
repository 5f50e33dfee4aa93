"""The rate of background activity, found from the events while the stream runs.

An event is isolated if none of the eight pixels around it had one shortly before. Where no contour
is, a sensor with r noise events per pixel and second has r exp(-8 r ISOLATED) isolated ones, which
gives r.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

ISOLATED = 0.005
"""An event is isolated if the pixels around had none for this time before, seconds."""
WINDOW = 0.1
"""Time after which the noise rate is found again, and old counts of a pixel halve, seconds."""
BLOCK = 16
"""Side of the blocks of pixels whose isolated events are counted."""
ENOUGH = 256
"""Number of blocks, spread evenly, that tell the noise rate of a large sensor."""
QUIET = 0.25
"""Share of the blocks with events that are taken for noise alone, the quietest ones."""
EXPECTED = 0.53
"""Mean number of supporters that noise has by chance: a tenth of it has two or more, and passes."""


def noise_rate(
    isolated: NDArray[np.int64], seen: NDArray[np.int64], exposure: NDArray[np.float64]
) -> float:
    """Estimate the background activity, events per pixel and second.

    `isolated` and `seen` are numbers of isolated and of all events, block by block; `exposure` is
    the blocks' number of pixels times the time, seconds. Of small blocks at the border too few
    events come to tell a rate.
    """
    active = (seen > 0) & (exposure >= exposure.max() / 2)
    rates = np.sort(isolated[active] / exposure[active])
    if len(rates) == 0:
        return 0.0
    rate = least = rates[int(QUIET * (len(rates) - 1))]
    for _ in range(10):  # rate exp(-8 rate ISOLATED) = least, for rates up to 1 / (8 ISOLATED)
        rate = min(least * np.exp(8 * rate * ISOLATED), 1 / (8 * ISOLATED))
    return float(rate)


def windows(t: NDArray[np.float64]) -> Iterator[tuple[int, int, int]]:
    """Cut times (N,) at multiples of WINDOW; yield window, first index and end of the parts."""
    first = 0
    while first < len(t):
        window = window_of(float(t[first]))
        last = int(np.searchsorted(t, (window + 1) * WINDOW))
        yield window, first, last
        first = last


def window_of(t: float) -> int:
    """Return the number n of a window, n WINDOW <= t < (n + 1) WINDOW as rounded products."""
    n = int(t / WINDOW)
    return n + (t >= (n + 1) * WINDOW) - (t < n * WINDOW)


def block_lengths(length: int) -> NDArray[np.int64]:
    """Return the sides of the blocks along an image's side, pixels; the last may be short."""
    return np.clip(length - BLOCK * np.arange(length // BLOCK + 1), 0, BLOCK)


def spread_blocks(rows: int, columns: int) -> NDArray[np.bool_]:
    """Choose about ENOUGH blocks (rows, columns), or all, in every so many rows and columns."""
    chosen = np.zeros((rows, columns), np.bool_)
    step = max(1, int(np.sqrt(rows * columns / ENOUGH)))
    chosen[::step, ::step] = True
    return chosen


def support_time(rate: float) -> float:
    """Return the time in which pixels around must have fired, seconds, at a noise rate.

    Noise has half of its events in each polarity.
    """
    return EXPECTED / (4 * rate)


def passing_share(rate: float, support: float) -> float:
    """Return the share of the noise that has two or more supporters within a time, seconds."""
    expected = 4 * rate * support
    return float(1 - (1 + expected) * np.exp(-expected))
