"""Estimate the offset between the cameras' clocks from their event rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

LONGEST_OFFSET = 2000
"""Largest offset that is searched for in both directions, milliseconds."""

SMOOTHING = 500
"""Milliseconds; slower changes of the rate carry little information about the offset."""

FEWEST_BINS = 1000
"""Milliseconds below which chance or flicker may look like an offset."""

CLEAR_PEAK = 0.3
"""Least correlation of the rates at a credible offset."""

CLEAR_GAIN = 0.65
"""What an offset leaves unexplained, as a share of what none leaves, at most."""

SMALLEST_OFFSET = 4
"""Milliseconds; the distance between the cameras alone shifts the rates by about this much."""

AS_GOOD = 0.01
"""Correlations this near to the best are as good: flicker repeats, and the least offset counts."""


def clock_offset(left: NDArray[np.int64], right: NDArray[np.int64]) -> float | None:
    """Return the delay of the right camera's stamps in seconds, or None without a clear one.

    Parameters
    ----------
    left, right
        Numbers of events in every millisecond of the recording.
    """
    length = min(len(left), len(right))
    if length < FEWEST_BINS:
        return None
    reach = min(LONGEST_OFFSET, length // 4)
    correlation = correlations(_fluctuation(left[:length]), _fluctuation(right[:length]), reach)
    best, none = correlation.max(), correlation[reach]
    lags = np.flatnonzero(correlation >= best - AS_GOOD) - reach
    lag = int(lags[np.abs(lags).argmin()])
    if abs(lag) < SMALLEST_OFFSET or best < CLEAR_PEAK or 1 - best > CLEAR_GAIN * (1 - none):
        return None
    near = slice(max(lag - SMALLEST_OFFSET, -reach) + reach, lag + SMALLEST_OFFSET + reach + 1)
    return (near.start + int(correlation[near].argmax()) - reach) / 1000.0


def events_per_millisecond(t: NDArray[np.float64], length: int = 0) -> NDArray[np.int64]:
    """Count the events at times (N,), seconds from 0 on, in `length` milliseconds or more."""
    return np.bincount((t * 1000).astype(np.int64), minlength=length)


def correlations(
    left: NDArray[np.float64], right: NDArray[np.float64], reach: int
) -> NDArray[np.float64]:
    """Correlate the middle of the left course with the right one, moved by -reach to reach.

    Every one of the (2 reach + 1) correlations is of all of the middle, so that ends do not count.
    """
    length, middle = len(left), left[reach : len(left) - reach]
    spectrum = np.fft.rfft(right) * np.conj(np.fft.rfft(middle, length))
    product = np.fft.irfft(spectrum, length)[: 2 * reach + 1]
    energy = np.concatenate([[0.0], np.cumsum(right**2)])
    norm = np.sqrt((energy[len(middle) :] - energy[: -len(middle)]) * (middle @ middle))
    return np.asarray(product / np.maximum(norm, 1e-9), np.float64)


def _fluctuation(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the event rate without its slow part; the root limits the weight of bursts."""
    rate = np.sqrt(counts.astype(np.float64))
    return rate - uniform_filter1d(rate, SMOOTHING)
