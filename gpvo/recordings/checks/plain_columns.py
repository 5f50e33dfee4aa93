"""Raw event columns as most files have them: without faults, and in order of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.base import Events
from gpvo.recordings.checks.columns import LATEST_SECONDS

Column = NDArray[np.float64]


def fill_plain(
    events: Events,
    x: Column,
    y: Column,
    seconds: Column,
    polarity: Column,
    resolution: tuple[int, int],
    origin: float,
    latest: float,
) -> bool:
    """Set events of the same number, with times since `origin`, seconds; False for any fault.

    A fault is a time before `latest` or the row above, or what the checks of single columns refuse:
    they say what it is. The kernel takes a fifth of the time of theirs.
    """
    if not (len(seconds) and seconds.dtype.isnative):
        return False
    given = x, y, seconds, polarity, resolution, origin, latest
    return _fill(*given, events.x, events.y, events.t, events.polarity)


@kernel
def _fill(
    x: Column,
    y: Column,
    seconds: Column,
    polarity: Column,
    resolution: tuple[int, int],
    origin: float,
    latest: float,
    columns: NDArray[np.uint16],
    rows: NDArray[np.uint16],
    t: NDArray[np.float64],
    ons: NDArray[np.bool_],
) -> bool:
    """Set the events' columns; return whether no given column has a fault."""
    plain = fill_pixels(x, resolution[0], columns) and fill_pixels(y, resolution[1], rows)
    return plain and fill_times(seconds, origin, latest, t) and fill_polarities(polarity, ons)


@kernel
def fill_pixels(given: Column, size: int, pixels: NDArray[np.uint16]) -> bool:
    """Set pixels (N,); return whether all are whole numbers from 0 to size - 1."""
    plain = True
    for i in range(len(given)):
        pixel = np.int32(given[i])
        plain &= bool(pixel == given[i] and 0 <= pixel < size)
        pixels[i] = pixel
    return plain


@kernel
def fill_times(seconds: Column, origin: float, latest: float, t: NDArray[np.float64]) -> bool:
    """Set times (N,), N > 0, since an origin; return whether they do not decrease from `latest`."""
    credible = abs(seconds[0]) < LATEST_SECONDS and abs(seconds[-1]) < LATEST_SECONDS
    plain = bool(credible and seconds[0] >= latest)
    for i in range(1, len(seconds)):
        plain &= seconds[i] >= seconds[i - 1]
    for i in range(len(seconds)):
        t[i] = seconds[i] - origin
    return plain


@kernel
def fill_polarities(given: Column, polarity: NDArray[np.bool_]) -> bool:
    """Set polarities (N,); return whether all are 1, 0 or -1."""
    plain = True
    for i in range(len(given)):
        plain &= given[i] == 1.0 or given[i] == -1.0 or given[i] == 0.0
        polarity[i] = given[i] == 1.0
    return plain
