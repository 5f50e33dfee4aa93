"""What columns without names hold, and the unit of times, by the numbers in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpvo.recordings.checks.time_unit import SINCE_1970

Array = NDArray[np.float64]

NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Nanoseconds in each unit."""
USUAL = 3e5
"""Events per second of usual cameras."""
SELDOM = 20.0
"""Events per second that the noise of a camera exceeds."""
FINEST = 500.0
"""Nanoseconds between neighbouring stamps: the clocks of sensors are no finer."""
SHORTEST, LONGEST = 5e8, 1e15
"""Nanoseconds, half a second and eleven days: recordings last so long."""
UNUSUAL = 2.0
"""Decimal orders of the rate that count as much as fractions do: they are those of seconds."""
MOST = 0.98
"""Share of the rows of which something has to be true, as lines may be damaged."""
DISORDER = 0.25
"""Share of the rows that may be earlier than the one before: packets of several cameras."""
USUAL_ORDER = {"t": 0, "x": 1, "y": 2, "polarity": 3}
"""The order of the RPG data sets."""
LARGEST_PIXEL = 65535


def column_roles(table: Array, resolution: tuple[int, int] | None) -> dict[str, int] | None:
    """Find t, x, y, polarity, and nanoseconds and camera where there are any.

    x is taken to come before y, unless only the other order fits the sensor.

    Parameters
    ----------
    table
        (N, M) numbers of some of the rows.
    resolution
        (width, height) of the sensor, if it is known.

    Returns
    -------
    Number of each column; None if these are no events.
    """
    if _is_usual(table):
        roles = USUAL_ORDER
        return roles | dict(zip("xy", _in_order(table, [1, 2], resolution), strict=True))
    left = list(range(table.shape[1]))
    seconds = next((k for k in left[:-1] if _are_seconds_and_nanoseconds(table, k)), None)
    rising = [k for k in left if _rises(table[:, k])] if seconds is None else [seconds]
    times = [k for k in rising if not _counts_rows(table[:, k])] or rising
    if not times:
        return None
    roles = {"t": times[0]} | ({} if seconds is None else {"nanoseconds": seconds + 1})
    left = [k for k in left if k not in rising and k not in roles.values()]
    marks = [k for k in left if _marks(table[:, k])]
    pixels = [k for k in left if k not in marks and _are_pixels(table[:, k])]
    if len(pixels) != 2 or not 1 <= len(marks) <= 2 or len(pixels) + len(marks) != len(left):
        return None
    signed = [k for k in marks if (table[:, k] < 0).any()]
    roles["polarity"] = (signed or marks)[0]
    if len(marks) == 2:
        roles["camera"] = sum(marks) - roles["polarity"]
    return roles | dict(zip("xy", _in_order(table, pixels, resolution), strict=True))


def found_unit(blocks: Sequence[Array]) -> str:
    """Find the unit of times, given those of consecutive events in each block.

    Stamps since 1970 tell it, unless events come too seldom then: microseconds of a sensor that
    runs for a quarter of an hour would be seconds of 2001. Else it is the one in which rate,
    resolution and duration are usual.
    """
    middle = float(np.median(blocks[0]))
    whole_span = np.quantile(blocks[-1], MOST) - np.quantile(blocks[0], 1 - MOST)
    steps = np.concatenate([np.diff(block) for block in blocks])
    steps = np.abs(steps[steps != 0])
    spans = [_span(block) for block in blocks if len(block) > 1]
    rate = sum(map(len, blocks)) / sum(spans) if sum(spans) > 0 else np.inf
    for unit, length in NANOSECONDS.items():
        since_1970 = SINCE_1970[0] <= middle * length / 1e9 <= SINCE_1970[1]
        if since_1970 and whole_span * length < LONGEST and rate / length * 1e9 > SELDOM:
            return unit
    if len(steps) == 0 or sum(spans) == 0:
        return "s"
    tick = float(np.quantile(steps, 0.05))
    strange = {unit: _strangeness(rate, tick, whole_span, ns) for unit, ns in NANOSECONDS.items()}
    whole = _are_whole(np.concatenate(blocks), -np.inf, np.inf)
    strange["s"] += UNUSUAL if whole else -UNUSUAL
    return min(strange, key=lambda unit: strange[unit])


def _span(times: Array) -> float:
    """Return the time between the first and the last, but for a few that are far off."""
    first, last = np.quantile(times, [1 - MOST, MOST])
    return float(last - first) / (2 * MOST - 1) or float(times.max() - times.min())


def _strangeness(rate: float, tick: float, span: float, length: int) -> float:
    """Return how unusual rate, resolution and duration are in a unit of `length` nanoseconds."""
    strange = abs(np.log10(rate / length * 1e9 / USUAL)) + (tick * length < FINEST)
    return float(strange + 0.5 * max(np.log10(SHORTEST / (span * length)), 0))


def _is_usual(table: Array) -> bool:
    t, *rest = table.T
    if len(rest) != 3 or (np.diff(t) < 0).mean() > DISORDER or (len(t) > 1 and t[-1] < t[0]):
        return False
    return _are_pixels(rest[0]) and _are_pixels(rest[1]) and _are_whole(rest[2], -1, 1)


def _rises(column: Array) -> bool:
    """Return whether times could be in a column: they rise, but for some disorder."""
    if len(column) < 2 or column[-1] <= column[0]:
        return False
    first, last = column[: -(-len(column) // 3)], column[-(len(column) // 3) :]
    apart = np.quantile(first, MOST) <= np.quantile(last, 1 - MOST)
    return bool(apart and (np.diff(column) < 0).mean() <= DISORDER)


def _counts_rows(column: Array) -> bool:
    return bool((np.diff(column) == 1).mean() >= 0.9)


def _are_whole(column: Array, least: float, most: float) -> bool:
    inside = (column == np.rint(column)) & (column >= least) & (column <= most)
    return bool(inside.mean() >= MOST)


def _are_pixels(column: Array) -> bool:
    return _are_whole(column, 0, LARGEST_PIXEL)


def _marks(column: Array) -> bool:
    """Return whether polarities or camera indices could be in a column."""
    return _are_whole(column, -1, 15) and len(np.unique(column)) <= 2


def _are_seconds_and_nanoseconds(table: Array, number: int) -> bool:
    seconds, nanoseconds = table[:, number], table[:, number + 1]
    if not (_are_whole(seconds, *SINCE_1970) and _are_whole(nanoseconds, 0, 1e9 - 1)):
        return False
    return bool(nanoseconds.max() > LARGEST_PIXEL)


def _in_order(
    table: Array, pixels: list[int], resolution: tuple[int, int] | None
) -> tuple[int, int]:
    """Return the columns of x and y."""
    first, second = pixels
    if resolution is None:
        return first, second
    width, height = resolution
    reach = np.quantile(table[:, pixels], MOST, axis=0)
    exchanged = reach[1] >= height and reach[0] < height and reach[1] < width
    return (second, first) if exchanged else (first, second)
