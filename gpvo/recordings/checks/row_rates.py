"""Count the events of both cameras in bands of rows, as they come, to compare the clocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.recordings.base import Events, StereoEvents
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.calibration.unknown import LARGEST
from gpvo.recordings.checks.clock_offset import BIN, ClockOffset, clock_offset

BANDS = 64
"""Number of bands of rectified rows."""
UNKNOWN_BAND = 16
"""Rows of a band of cameras without calibration."""
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
        self._bands = [_bands(rig, side) for side in (0, 1)]
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
            self._count(side, events[::some], some, first, stop)

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

    def _count(self, side: int, events: Events, weight: int, first: int, stop: int) -> None:
        """Add the events of the bins from `first` to before `stop`, each `weight` times."""
        bands, y = self._bands[side], events.y
        band = y // UNKNOWN_BAND if bands is None else bands[y, events.x]
        time = np.minimum((events.t / BIN).astype(np.int64), stop - 1) - first  # may be rounded up
        inside = (band < BANDS) & (time >= 0)
        row = 2 * band[inside].astype(np.int64) + events.polarity[inside]
        shape = 2 * BANDS, stop - first
        count = np.bincount(row * shape[1] + time[inside], minlength=shape[0] * shape[1])
        place = slice(first - self._first, stop - self._first)
        self._counts[side, :, place] += weight * count.reshape(shape)


def _bands(rig: StereoRig, side: int) -> NDArray[np.uint8] | None:
    """Return the band of each raw pixel, BANDS outside; None without calibration."""
    height = rig.resolution[1]
    if rig.resolution == LARGEST:
        return None
    row = rig.tables[side][:, :, 1]
    inside = (row >= 0) & (row < height)
    return np.where(inside, np.where(inside, row, 0) * BANDS / height, BANDS).astype(np.uint8)
