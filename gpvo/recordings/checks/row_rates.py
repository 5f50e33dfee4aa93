"""Count the events of both cameras in bands of rows, as they come, to compare the clocks.

A camera that turns evenly sees a contour enter and leave the left image's rows, and the right
one's later, by disparity / image speed: it looks as if the right clock were late. So events count
by sin^2(pi x / width): contours fade in and out, and slow changes of the rates do not count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.base import Events, StereoEvents
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.calibration.unknown import LARGEST
from gpvo.recordings.checks.clock_offset import BIN, ClockOffset, clock_offset

BANDS = 64
"""Number of bands of rectified rows."""
UNKNOWN_BAND = 16
"""Rows of a band of cameras without calibration, whose columns all count alike."""
STEPS = 64
"""Parts of which an event's weight is a whole number: sums are exact in any order."""
MOST = 300_000
"""Events per second that are counted of a camera; of more, every second, third ..."""


class RowRates:
    """Numbers of events in bands of rows in the latest bins of time.

    Parameters
    ----------
    rig
        The stereo rig, which rectifies rows.
    remembered
        Seconds of which the numbers are known.

    Attributes
    ----------
    stop
        Bin before which all events are counted, since the recording's start.
    """

    def __init__(self, rig: StereoRig, remembered: float) -> None:
        self._pixels = [_pixels(rig, side) for side in (0, 1)]
        self._size = round(remembered / BIN)
        self._counts = np.zeros((2, 2 * BANDS, 2 * self._size), np.float32)
        self._first = self.stop = 0

    @property
    def seconds(self) -> float:
        """Time of which the numbers are known."""
        return min(self.stop - self._first, self._size) * BIN

    @property
    def start(self) -> float:
        """Where that time begins, seconds since the recording's start."""
        return self.stop * BIN - self.seconds

    def add(self, batch: StereoEvents) -> None:
        """Count the next events of the stream."""
        first, stop = int(batch.start / BIN), int(np.ceil(batch.stop / BIN))
        if self.stop == 0 or first - self.stop > self._size:
            self._counts[:], self._first, self.stop = 0, first, first
        if stop - self._first > self._counts.shape[2]:
            self._forget(stop)
        first, self.stop = max(first, self._first), max(stop, self.stop)
        each = MOST * max(batch.stop - batch.start, BIN)
        for side, events in enumerate((batch.left, batch.right)):
            some = int(len(events) / each) + 1
            self._count(side, events, some, first, stop)

    def counts(self) -> NDArray[np.float32]:
        """Return the numbers (2, bands, bins) of left and right camera, without the newest bin."""
        stop = self.stop - self._first - 1
        return self._counts[:, :, max(stop - self._size, 0) : max(stop, 0)]

    def offset(self) -> ClockOffset | None:
        """Estimate by how much the right camera's stamps are late; None without a clear result."""
        return clock_offset(*self.counts())

    def _forget(self, stop: int) -> None:
        """Keep the latest bins before `stop`, at the beginning of the memory."""
        begin = stop - self._size
        known = self._counts[:, :, begin - self._first :].copy()
        self._counts[:], self._first = 0, begin
        self._counts[:, :, : known.shape[2]] = known

    def _count(self, side: int, events: Events, some: int, first: int, stop: int) -> None:
        """Add one of `some` events of the bins from `first` to before `stop`, as if it were all."""
        count = np.zeros((2 * BANDS, stop - first), np.float32)
        columns = events.x, events.y, events.t, events.polarity
        _add_weights(count, *self._pixels[side], *columns, some, first)
        place = slice(first - self._first, stop - self._first)
        self._counts[side, :, place] += some * count


class _Pixels(NamedTuple):
    """What each raw pixel (height, width) counts for; the last column stands for all after it."""

    band: NDArray[np.uint8]  # BANDS outside of the rectified rows
    weight: NDArray[np.float32]


def _pixels(rig: StereoRig, side: int) -> _Pixels:
    """Return what the pixels count for; without calibration all columns are alike."""
    if rig.resolution == LARGEST:
        band = np.minimum(np.arange(LARGEST[1] + 1) // UNKNOWN_BAND, BANDS)[:, None]
        return _Pixels(band.astype(np.uint8), np.ones(band.shape, np.float32))
    (width, height), x_y = rig.resolution, rig.tables[side]
    row, part = x_y[:, :, 1], np.clip((x_y[:, :, 0] + 0.5) / width, 0.0, 1.0)
    inside = (row >= 0) & (row < height)
    band = np.where(inside, np.where(inside, row, 0) * BANDS / height, BANDS)
    weight = np.round(STEPS * np.sin(np.pi * part) ** 2) / STEPS
    return _Pixels(band.astype(np.uint8), weight.astype(np.float32))


@kernel
def _add_weights(
    counts: NDArray[np.float32],
    band: NDArray[np.uint8],
    weight: NDArray[np.float32],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.float64],
    polarity: NDArray[np.bool_],
    some: int,
    first: int,
) -> None:
    """Add the first of each `some` events (N,) to the numbers (2 bands, bins) from a bin on."""
    for i in range(0, len(t), some):
        column = min(np.int64(x[i]), band.shape[1] - 1)
        row = np.int64(band[y[i], column])
        time = min(np.int64(t[i] / BIN) - first, counts.shape[1] - 1)  # t may be rounded up
        if row < BANDS and time >= 0:
            counts[2 * row + polarity[i], time] += weight[y[i], column]
