"""Events as cameras and users give them: four arrays, checked before anything is done with them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpvo.errors import InputError
from gpvo.recordings import Camera
from gpvo.recordings.checks.first_faulty import first_faulty
from gpvo.recordings.streams import EventBlock

RawEvents = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]
"""x, y, t, polarity (N,) of one camera: columns, rows, int64 microseconds, and 1 or True where the
pixel became brighter, else 0, -1 or False."""

LARGEST_US = 2**62 // 1000
"""Microseconds since 1970 until the year 2116: differences of stamps fit into int64 nanoseconds."""

NO_EVENTS: RawEvents = ((), (), (), ())


def checked_events(events: RawEvents, side: str, camera: Camera, before_ns: int) -> EventBlock:
    """Check one camera's events.

    Parameters
    ----------
    side
        left or right, for the message.
    before_ns
        Stamp of the camera's event before, which none may precede.

    Raises
    ------
    InputError
        If they are not four arrays of whole numbers and one length, lie outside the sensor, or go
        back in time.
    """
    if not isinstance(events, tuple) or len(events) != 4:
        raise InputError(f"{side}: events must be a tuple of four arrays (x, y, t, polarity)")
    try:
        x, y, t, polarity = columns = [np.asarray(column) for column in events]
    except ValueError as error:
        raise InputError(f"{side}: events are no arrays: {error}") from error
    lengths = [column.shape for column in columns]
    if len(set(lengths)) != 1 or x.ndim != 1:
        raise InputError(f"{side}: x, y, t, polarity must have one length, not {lengths}")
    if len(x) == 0:
        return EventBlock.empty()
    if _are_of_a_block(columns) and first_faulty(x, y, t, camera, before_ns // 1000) is None:
        # Copies: a driver may fill the same arrays again.
        return EventBlock(x.copy(), y.copy(), _nanoseconds(t, f"{side} t"), polarity.copy())
    for name, column in zip(("x", "y", "t"), columns, strict=False):
        _check_whole(column, f"{side} {name}")
    for name, column, size in zip("xy", (x, y), camera.resolution, strict=True):
        _check_inside(column, size, f"{side} {name}")
    t_ns = _nanoseconds(t, f"{side} t")
    _check_order(t_ns, before_ns, f"{side} t")
    is_on = _checked_polarity(polarity, f"{side} polarity")
    return EventBlock(x.astype(np.uint16), y.astype(np.uint16), t_ns, is_on)


def check_steps(t_ns: NDArray[np.int64], before_ns: int, longest_ns: int, name: str) -> None:
    """Raise InputError if stamps (N,) go on by more than so long from one to the next."""
    steps = np.diff(np.maximum(t_ns, before_ns), prepend=before_ns)
    index = int(np.argmax(steps))
    if steps[index] > longest_ns:
        raise InputError(
            f"{name}: goes on by {steps[index] / 1e9:g} s at event {index}, more than"
            f" {longest_ns / 1e9:g} s; give microseconds of one clock, and call interrupted() where"
            " data is missing"
        )


def _are_of_a_block(columns: list[NDArray[Any]]) -> bool:
    """Whether arrays (N,) have the types of an `EventBlock`, so that one pass can check them."""
    kinds = ("u2", "u2", "i8", "?")
    return all(column.dtype == kind for column, kind in zip(columns, kinds, strict=True))


def _check_whole(column: NDArray[Any], name: str) -> None:
    if column.dtype.kind not in "iu":
        raise InputError(f"{name}: must be whole numbers (int or uint), not {column.dtype}")


def _check_inside(column: NDArray[Any], size: int, name: str) -> None:
    outside = (column < 0) | (column >= size)
    if outside.any():
        index = int(np.argmax(outside))
        raise InputError(
            f"{name}: {column[index]} at event {index} is not from 0 to {size - 1}; leave such"
            " events out, or give this camera's calibration"
        )


def _nanoseconds(t: NDArray[Any], name: str) -> NDArray[np.int64]:
    for extreme in (int(t.max()), int(t.min())):
        if abs(extreme) > LARGEST_US:
            raise InputError(f"{name}: {extreme} is too large for microseconds")
    return t.astype(np.int64) * 1000


def _check_order(t_ns: NDArray[np.int64], before_ns: int, name: str) -> None:
    steps = np.diff(t_ns, prepend=max(before_ns, -(2**62)))
    if steps.min() < 0:
        index = int(np.argmin(steps))
        raise InputError(
            f"{name}: goes back by {-steps[index] // 1000} us at event {index}; push events in"
            " order of time"
        )


def _checked_polarity(polarity: NDArray[Any], name: str) -> NDArray[np.bool_]:
    if polarity.dtype.kind == "b":
        return np.array(polarity, np.bool_)
    if polarity.dtype.kind not in "iu" or not np.isin(polarity, (-1, 0, 1)).all():
        raise InputError(f"{name}: must be bool, or 1 and 0 or -1")
    return np.asarray(polarity == 1)
