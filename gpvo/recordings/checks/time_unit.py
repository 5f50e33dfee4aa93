"""Check that times are seconds: in another unit events seem to come implausibly seldom."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.base import Recording

SAMPLE = 3000
"""Number of events of a camera that are looked at, the first ones."""
LONGEST = 20_000
"""Number of batches after which no more is read."""
SLOWEST = 1000
"""Events per second that every camera that sees or hears noise exceeds at times."""
WINDOW = 1000
"""Number of events in which it does."""
UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
ROUNDING = 0.3
"""Microseconds by which float64 stamps since 1970 may be off."""
PLAUSIBLE = 1e9
"""Events per second that no camera exceeds."""


def check_time_unit(recording: Recording) -> None:
    """Compare the first events' rate and their stamps' resolution with those of cameras.

    Raises
    ------
    InputError
        If the times are those of a camera, but in another unit; the message names it.
    """
    t = _first_times(recording)
    if len(t) <= WINDOW:
        return
    rate = WINDOW / max(float((t[WINDOW:] - t[:-WINDOW]).min()), 1e-9)
    unit = fitting_unit(t, rate) if rate < SLOWEST else None
    if unit is not None:
        raise InputError(
            f"{recording.path}: the cameras send at most {rate:.3g} events per second: are the"
            f" times {unit}? they must be seconds; convert them"
        )


def fitting_unit(t: NDArray[np.float64], rate: float) -> str | None:
    """Return the unit in which stamps (N,) have the resolution of cameras, a microsecond or more.

    `rate` is that of the events if they were seconds. None if seconds fit.
    """
    for unit, seconds in reversed(UNITS.items()):
        ticks = t * (seconds / 1e-6)
        whole = np.abs(ticks - np.rint(ticks)) < ROUNDING
        if whole.mean() > 0.99 and SLOWEST <= rate / seconds < PLAUSIBLE:
            return unit
    return None


def _first_times(recording: Recording) -> NDArray[np.float64]:
    """Return the times of the first events of the left camera, of the right one without any."""
    sides: dict[str, list[NDArray[np.float64]]] = {side: [] for side in recording.sides}
    for number, batch in enumerate(recording.event_batches()):
        for side, times in sides.items():
            times.append(getattr(batch, side).t)
        if min(sum(map(len, times)) for times in sides.values()) >= SAMPLE or number >= LONGEST:
            break
    first = [np.concatenate([*times, np.empty(0)])[:SAMPLE] for times in sides.values()]
    return first[0] if len(first[0]) > WINDOW else first[-1]
