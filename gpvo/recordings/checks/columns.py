"""Checks on raw event columns; each fault is one InputError that names the row."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.checks.time_unit import check_since_1970

LATEST_SECONDS = 9e9
"""About the year 2255; later stamps do not fit into int64 nanoseconds."""

LONGEST_SECONDS = 1e6
"""Eleven days; a recording that seems longer probably has its times in microseconds."""


def check_times(
    seconds: NDArray[np.float64], before: float, where: str, first_row: int = 0
) -> None:
    """Raise InputError unless times are finite and do not go backwards.

    Parameters
    ----------
    seconds
        (N,) times of the rows from first_row on.
    before
        Time of the row before the first; -inf if there is none.
    where
        File and field; the start of the message.
    """
    bad = ~(np.abs(seconds) < LATEST_SECONDS)
    if bad.any():
        row = int(np.argmax(bad))
        if bad.all():
            check_since_1970(float(seconds[row]), "seconds", f"{where} row {first_row + row}")
        _fail(where, first_row + row, f"time {seconds[row]} is not a time in seconds")
    backwards = np.diff(seconds, prepend=before) < 0.0
    if backwards.any():
        row = int(np.argmax(backwards))
        earlier = before if row == 0 else seconds[row - 1]
        _fail(
            where,
            first_row + row,
            f"time {seconds[row]:.6f} s is before {earlier:.6f} s of the row above;"
            " sort the events by time",
        )


def pixels(
    coordinate: NDArray[np.float64], size: int, axis: str, where: str, first_row: int
) -> NDArray[np.uint16]:
    """Return pixels (N,) uint16; raise InputError unless whole numbers from 0 to size - 1."""
    with np.errstate(invalid="ignore"):
        whole = coordinate.astype(np.uint16)
    bad = (whole != coordinate) | (whole >= size)
    if bad.any():
        row = int(np.argmax(bad))
        _fail(
            where,
            first_row + row,
            f"{axis} = {coordinate[row]} is not a whole number from 0 to {size - 1};"
            " repair the file, or give the calibration of this camera's resolution",
        )
    return whole


def polarities(polarity: NDArray[np.float64], where: str, first_row: int) -> NDArray[np.bool_]:
    """Return (N,) bool, True for 1 and False for -1 or 0; raise InputError for other values."""
    on = polarity == 1.0
    bad = ~(on | (polarity == -1.0) | (polarity == 0.0))
    if bad.any():
        row = int(np.argmax(bad))
        _fail(where, first_row + row, f"polarity {polarity[row]} is none of -1, 0 and 1")
    return on


def check_common_time(
    left: tuple[float, float], right: tuple[float, float], path: object, fields: str
) -> None:
    """Raise InputError unless (first, last) seconds of both cameras overlap and are credible."""
    if max(left[1], right[1]) - min(left[0], right[0]) > LONGEST_SECONDS:
        problem = f"span more than {LONGEST_SECONDS:.0f} s; times must be seconds"
    elif left[1] < right[0] or right[1] < left[0]:
        problem = "have no time in common; both cameras must be recorded with one clock"
    else:
        return
    raise InputError(
        f"{path}: {fields} {problem} (left from {left[0]:.6f} to {left[1]:.6f} s,"
        f" right from {right[0]:.6f} to {right[1]:.6f} s)"
    )


def _fail(where: str, row: int, problem: str) -> NoReturn:
    raise InputError(f"{where} row {row}: {problem}")
