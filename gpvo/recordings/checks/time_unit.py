"""Check that times have the unit in which they are read: in others, events come too seldom or late.

Stamps since 1970 show their unit by themselves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.base import Recording

SAMPLE = 3000
"""Number of events of a camera that are looked at, the first ones."""
LONGEST = 5000
"""Number of batches after which no more is read."""
SLOWEST, FASTEST = 1000, 1e7
"""Events per second that every camera that sees or hears noise exceeds at times, and never."""
WINDOW = 1000
"""Number of events in which it does."""
QUIET = 300.0
"""Seconds in which no camera has fewer."""
UNITS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
SINCE_1970 = (8e8, 4.2e9)
"""Seconds from 1995 to 2100."""
ROUNDING = 0.3
"""Microseconds by which float64 stamps since 1970 may be off."""
PLAUSIBLE = 1e9
"""Events per second that no camera exceeds."""


def unit_since_1970(time: float) -> str | None:
    """Return the unit in which a time is a stamp of the years 1995 to 2100; None for none."""
    for unit, seconds in UNITS.items():
        if SINCE_1970[0] <= time * seconds <= SINCE_1970[1]:
            return unit
    return None


def check_since_1970(time: float, read_as: str, where: str) -> None:
    """Raise InputError if a time that is read in one unit is a stamp since 1970 in a finer one."""
    unit = unit_since_1970(time)
    if unit is not None and UNITS[unit] < UNITS[read_as]:
        raise InputError(
            f"{where}: time {time:.17g} seems to be {unit} since 1970; times must be {read_as}:"
            " convert them"
        )


def check_time_unit(recording: Recording) -> None:
    """Compare the first events' rate and their stamps' resolution with those of cameras.

    Raises
    ------
    InputError
        If the times are those of a camera, but in another unit; the message names it.
    """
    t, stop = _first_times(recording)
    if len(t) > WINDOW:
        rate = WINDOW / max(float((t[WINDOW:] - t[:-WINDOW]).min()), 1e-9)
    elif len(t) > 1 and stop > QUIET:
        rate = len(t) / stop
    else:
        return
    read_as = recording.time_unit
    unit = fitting_unit(t, rate, read_as) if rate < SLOWEST else None
    mean = len(t) / max(float(t[-1] - t[0]), 1e-9)
    stamp = unit_since_1970(recording.start_ns * 1e-9 / UNITS[read_as])
    if mean > FASTEST and stamp is not None and UNITS[stamp] > UNITS[read_as]:
        unit = f"{stamp} since 1970"
    if unit is not None:
        raise InputError(
            f"{recording.path}: the cameras send {rate:.3g} events per second at most: are the"
            f" times {unit}? they must be {read_as}; convert them"
        )


def fitting_unit(t: NDArray[np.float64], rate: float, read_as: str = "seconds") -> str | None:
    """Return the unit in which stamps (N,) have the resolution of cameras, a microsecond or more.

    `t` is in seconds, and `rate` that of the events, if the unit `read_as` is right. None if it is.
    """
    for unit, length in reversed(UNITS.items()):
        ratio = length / UNITS[read_as]
        ticks = t * (ratio / 1e-6)
        whole = np.abs(ticks - np.rint(ticks)) < ROUNDING
        if ratio < 1 and whole.mean() > 0.99 and SLOWEST <= rate / ratio < PLAUSIBLE:
            return unit
    return None


def _first_times(recording: Recording) -> tuple[NDArray[np.float64], float]:
    """Return the times of the first events of one camera, and when those that were read end.

    It is the left camera, or the right one if that one has none.
    """
    stop = 0.0
    sides: dict[str, list[NDArray[np.float64]]] = {side: [] for side in recording.sides}
    for number, batch in enumerate(recording.event_batches()):
        for side, times in sides.items():
            times.append(getattr(batch, side).t)
        stop = batch.stop
        if min(sum(map(len, times)) for times in sides.values()) >= SAMPLE or number >= LONGEST:
            break
    first = [np.concatenate([*times, np.empty(0)])[:SAMPLE] for times in sides.values()]
    return first[0] if len(first[0]) > WINDOW else first[-1], stop
