"""Estimate the offset between the cameras' clocks from their event rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

LONGEST_OFFSET = 2000
"""Largest offset that is searched for in both directions, milliseconds."""

SMOOTHING = 500
"""Milliseconds; slower changes of the rate carry little information about the offset."""

FEWEST_BINS = 200
CLEAR_PEAK = 0.3
"""Least correlation of the rates at a credible offset."""

CLEAR_GAIN = 0.1
"""Least gain of this correlation over that without an offset."""

SMALLEST_OFFSET = 4
"""Milliseconds; the distance between the cameras alone shifts the rates by about this much."""


def clock_offset(left: NDArray[np.int64], right: NDArray[np.int64]) -> float | None:
    """Return the delay of the right camera's stamps in seconds, or None without a clear one.

    Parameters
    ----------
    left, right
        Numbers of events in every millisecond of the recording.
    """
    from scipy.signal import correlate  # slow to import, and only `gpvo info` needs it

    length = min(len(left), len(right))
    a, b = _fluctuation(left[:length]), _fluctuation(right[:length])
    norm = np.linalg.norm(a) * np.linalg.norm(b)
    if length < FEWEST_BINS or norm == 0.0:
        return None
    correlation = correlate(b, a, method="fft") / norm
    reach = min(LONGEST_OFFSET, length // 4)
    window = correlation[length - 1 - reach : length + reach]
    lag = int(np.argmax(window)) - reach
    gain = window[lag + reach] - window[reach]
    if abs(lag) < SMALLEST_OFFSET or window[lag + reach] < CLEAR_PEAK or gain < CLEAR_GAIN:
        return None
    return lag / 1000.0


def _fluctuation(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the event rate without its slow part; the root limits the weight of bursts."""
    rate = np.sqrt(counts.astype(np.float64))
    return rate - uniform_filter1d(rate, SMOOTHING)
