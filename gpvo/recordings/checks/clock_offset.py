"""Estimate the offset between the cameras' clocks from the course of events in bands of rows.

A point of the scene has the same row in both rectified images, whatever its disparity. So the
numbers of events of a band of rows, brighter and darker ones apart, follow each other in time. The
rates of whole images do as well, but contours enter and leave them at other times, which looks like
an offset if the cameras are far apart. Rows that differ because of a wrong calibration look like an
offset, too, while the image moves up or down; so the whole rates have to confirm one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

Array = NDArray[np.float64]
Rates = NDArray[np.float32]

BIN = 0.002
"""Seconds in which events are counted."""
LONGEST_OFFSET = 2.0
"""Largest offset that is searched for in both directions, seconds."""
SLOW, FAST = 100, 8
"""Bins: slower changes carry little information, faster ones are noise and flicker."""
SHORTEST = 1.0
"""Seconds below which chance or flicker may look like an offset."""
OWN_DEVIATION = 0.002
"""Standard deviation of the estimate where all bands agree, seconds: occlusions and flicker."""
CLEAR = 1.2
"""Least product of a clear peak's correlation and its ratio to the scatter of the others; below
0.9 where the cameras see different things."""
AS_GOOD = 0.99
"""Ratio of peaks that are as good as the highest: flicker repeats, and the least offset counts."""
FLAT = 0.98
"""Share of a peak's height above which it is flat: flicker moves its top there."""
GROUPS = 8
"""Number of groups of bands, each of which is left out once to find the deviation (jackknife)."""


class ClockOffset(NamedTuple):
    """Seconds by which the right camera's stamps are late, and their standard deviation."""

    seconds: float
    deviation: float

    def __str__(self) -> str:
        return f"{self.seconds:+.3f} s (within {2 * self.deviation:.3f} s)"

    @property
    def is_apart(self) -> bool:
        """Whether the clocks are apart beyond doubt."""
        return abs(self.seconds) > 3 * self.deviation


def clock_offset(left: NDArray, right: NDArray) -> ClockOffset | None:
    """Estimate the delay of the right camera's stamps; None without a clear one.

    Parameters
    ----------
    left, right
        (B, N) numbers of events of B bands of rows in consecutive bins of `BIN` seconds.
    """
    length = min(left.shape[1], right.shape[1])
    if length * BIN < SHORTEST:
        return None
    reach = min(round(LONGEST_OFFSET / BIN), length // 4)
    left, right = left[:, :length], right[:, :length]
    both = _fluctuation(left), _fluctuation(right)
    products = lagged_products(*both, reach)
    total = products.sum(axis=0) / _norm(*both, reach)
    lag = _least_peak(total)
    if total[lag] ** 2 <= CLEAR * 1.4826 * np.median(np.abs(total - np.median(total))):
        return None
    scatter = float(np.hypot(_deviation(products, lag), 0.25 * _width(total, lag)))
    seconds = BIN * (_refined(total, lag) - reach)
    if not _is_confirmed(left, right, lag, reach):
        scatter = max(scatter, abs(seconds) / BIN)
    return ClockOffset(seconds, float(np.hypot(BIN * scatter, OWN_DEVIATION)))


def _is_confirmed(left: NDArray, right: NDArray, lag: int, reach: int) -> bool:
    """Return whether the rates of the whole images agree better at a lag than without it."""
    both = _fluctuation(left.sum(axis=0)[None]), _fluctuation(right.sum(axis=0)[None])
    total = lagged_products(*both, reach)[0] / _norm(*both, reach)
    return bool(total[lag] > total[reach])


def lagged_products(left: Rates, right: Rates, reach: int) -> Array:
    """Multiply the middle of left courses (B, N) with right ones, moved by -reach to reach bins.

    Every sum is of all of the middle, so that ends do not count. Returns the sums (G, 2 reach + 1)
    of each group of bands: every G-th is in the same one.
    """
    length, groups = next_fast_len(left.shape[1], real=True), min(GROUPS, len(left))
    middle = left[:, reach : left.shape[1] - reach]
    spectrum = rfft(right, length) * np.conj(rfft(middle, length))
    grouped = np.stack([spectrum[k::groups].sum(axis=0) for k in range(groups)])
    return irfft(grouped, length, axis=1)[:, : 2 * reach + 1].astype(np.float64)


def _norm(left: Rates, right: Rates, reach: int) -> Array:
    """Return the factors (2 reach + 1,) between sums of products and correlations."""
    length = left.shape[1]
    energy = np.concatenate([[0.0], np.cumsum((right**2).sum(axis=0, dtype=np.float64))])
    moved = energy[length - 2 * reach :] - energy[: 2 * reach + 1]
    middle = (left[:, reach : length - reach] ** 2).sum(dtype=np.float64)
    return np.asarray(np.sqrt(moved * middle) + 1e-9)


def _least_peak(correlation: Array) -> int:
    """Return the place of the peak nearest to the middle, of those that are as good as the best."""
    inner = correlation[1:-1]
    peaks = 1 + np.flatnonzero((inner >= correlation[:-2]) & (inner >= correlation[2:]))
    good = peaks[correlation[peaks] >= AS_GOOD * correlation.max()]
    if len(good) == 0:
        return int(correlation.argmax())
    return int(good[np.abs(good - len(correlation) // 2).argmin()])


def _refined(correlation: Array, peak: int) -> float:
    """Return the place of the parabola's top through a peak and its neighbours."""
    if not 0 < peak < len(correlation) - 1:
        return float(peak)
    before, top, after = correlation[peak - 1 : peak + 2]
    curvature = before - 2 * top + after
    return peak + (float(np.clip(0.5 * (before - after) / curvature, -1, 1)) if curvature else 0.0)


def _deviation(products: Array, peak: int) -> float:
    """Return the standard deviation of a peak's place, bins, by leaving out groups of bands."""
    total, near = products.sum(axis=0), slice(max(peak - 2 * FAST, 0), peak + 2 * FAST + 1)
    groups = len(products)
    without = [(total - group)[near] for group in products]
    places = [_refined(part, int(part.argmax())) for part in without] if groups > 1 else [0.0]
    return float(np.sqrt(groups - 1) * np.std(places))


def _width(correlation: Array, peak: int) -> int:
    """Return the number of bins around a peak in which the correlation is almost as high."""
    lower = np.flatnonzero(correlation < FLAT * correlation[peak])
    before, after = lower[lower < peak], lower[lower > peak]
    first = before[-1] if len(before) else -1
    return int((after[0] if len(after) else len(correlation)) - first - 1)


def _fluctuation(counts: NDArray) -> Rates:
    """Return rates without their slow and fast parts; the root limits the weight of bursts."""
    rate = np.sqrt(uniform_filter1d(counts.astype(np.float32), FAST, axis=1))
    return np.asarray(rate - uniform_filter1d(rate, SLOW, axis=1))
