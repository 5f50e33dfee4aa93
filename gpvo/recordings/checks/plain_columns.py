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
    they say what it is. One pass over all columns takes a fifth of the time of theirs.
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
    plain = abs(seconds[0]) < LATEST_SECONDS and abs(seconds[-1]) < LATEST_SECONDS
    plain &= seconds[0] >= latest
    for i in range(1, len(seconds)):
        plain &= seconds[i] >= seconds[i - 1]
    for i in range(len(x)):
        u, v, sign = np.int32(x[i]), np.int32(y[i]), polarity[i]
        plain &= u == x[i] and v == y[i] and 0 <= u < resolution[0] and 0 <= v < resolution[1]
        plain &= sign == 1.0 or sign == -1.0 or sign == 0.0
        columns[i], rows[i], t[i], ons[i] = u, v, seconds[i] - origin, sign == 1.0
    return plain
