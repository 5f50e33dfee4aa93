"""Unpack MVSEC's events from gzip in one call for many chunks, which holds up no other thread."""

from __future__ import annotations

import h5py
import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_vector_kernel
from gpvo.recordings import libdeflate
from gpvo.recordings.base import Events
from gpvo.recordings.checks.plain_columns import Column, fill_pixels, fill_polarities, fill_times
from gpvo.recordings.gzip_chunks import is_shuffled, read_chunk, room_for
from gpvo.recordings.libdeflate import free_decompressor, new_decompressor, unpack

COLUMNS, BYTES = 4, 8
"""Columns of a table of events, and bytes of a number in it."""
TOGETHER = 1024
"""Rows that stay in the processor's first cache while they are converted."""

Bytes = NDArray[np.uint8]
EventColumns = tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.float64], NDArray[np.bool_]]
"""Columns x, y, t and polarity of events."""


class EventChunks:
    """Chunks of a table (N, 4) float64 of events, each with rows of one column, packed by gzip."""

    def __init__(self, dataset: h5py.Dataset, shuffled: bool) -> None:
        self._id, self._size, self._shuffled = dataset.id, dataset.chunks[0], shuffled
        self._room = room_for(self._size * BYTES)
        self._packed = np.empty(0, np.uint8)
        self._data = np.empty(self._size * BYTES, np.uint8)

    @staticmethod
    def of(dataset: h5py.Dataset) -> EventChunks | None:
        """Return the chunks of a table; None if they are packed otherwise, or libdeflate hides."""
        shuffled = is_shuffled(dataset, dimensions=2)
        if shuffled is None or not (libdeflate.IS_THERE and dataset.dtype.isnative):
            return None
        return EventChunks(dataset, shuffled)

    def fill(
        self,
        events: Events,
        first_row: int,
        resolution: tuple[int, int],
        origin: float,
        latest: float,
    ) -> float | None:
        """Set events from `first_row` on as `fill_plain` does; return the last time, seconds.

        None for any fault, for a row amid a chunk, and for damaged chunks.
        """
        if first_row % self._size:
            return None
        try:
            ends = self._read(range(first_row, first_row + len(events), self._size))
        except (OSError, RuntimeError, ValueError):
            return None
        given = self._packed, ends, self._shuffled, self._data, resolution, origin, latest
        plain, last = _unpacked(*given, (events.x, events.y, events.t, events.polarity))
        return float(last) if plain else None

    def _read(self, rows: range) -> NDArray[np.int64]:
        """Read the chunks that begin at rows; return their ends (chunks, 4) in what was read."""
        ends = np.empty((len(rows), COLUMNS), np.int64)
        if len(self._packed) < ends.size * self._room:
            self._packed = np.empty(ends.size * self._room, np.uint8)
        end = 0
        for number, row in enumerate(rows):
            for column in range(COLUMNS):
                room = self._packed[end : end + self._room]
                end += len(read_chunk(self._id, (row, column), room))
                ends[number, column] = end
        return ends


@kernel
def _unpacked(
    packed: Bytes,
    ends: NDArray[np.int64],
    shuffled: bool,
    data: Bytes,
    resolution: tuple[int, int],
    origin: float,
    latest: float,
    events: EventColumns,
) -> tuple[bool, float]:
    """Set the events of all chunks; return whether none has a fault, and the time of the last."""
    decompressor, size = new_decompressor(), data.size // BYTES
    x, y, t, polarity = events
    plain, begin = True, 0
    for chunk in range(len(ends)):
        rows = slice(chunk * size, min(chunk * size + size, len(t)))
        part = x[rows], y[rows], t[rows], polarity[rows]
        for column in range(COLUMNS):
            end = ends[chunk, column]
            plain = plain and unpack(decompressor, packed[begin:end], data)
            begin = end
            if plain:
                given = data, shuffled, resolution, origin, latest
                plain, latest = _converted(column, *given, part)
    free_decompressor(decompressor)
    return plain, latest


@kernel
def _converted(
    column: int,
    data: Bytes,
    shuffled: bool,
    resolution: tuple[int, int],
    origin: float,
    latest: float,
    events: EventColumns,
) -> tuple[bool, float]:
    """Set a column of a chunk's events; return whether it has no fault, and the latest time."""
    x, y, t, polarity = events
    plain, words = True, np.empty(TOGETHER, np.uint64)
    for first in range(0, len(t), TOGETHER):
        stop = min(first + TOGETHER, len(t))
        given = _numbers(data, shuffled, first, words[: stop - first])
        if column == 0:
            plain &= fill_pixels(given, resolution[0], x[first:stop])
        elif column == 1:
            plain &= fill_pixels(given, resolution[1], y[first:stop])
        elif column == 2:
            plain &= fill_times(given, origin, latest, t[first:stop])
            latest = given[-1]
        else:
            plain &= fill_polarities(given, polarity[first:stop])
    return plain, latest


@kernel
def _numbers(data: Bytes, shuffled: bool, first: int, words: NDArray[np.uint64]) -> Column:
    """Return the numbers of a chunk from the row `first` on, as many as there are words."""
    if shuffled:
        _unshuffle(data, first, words)
    else:
        copy_vector_kernel(data.view(np.uint64)[first : first + len(words)], words)
    return words.view(np.float64)


@kernel
def _unshuffle(data: Bytes, first: int, words: NDArray[np.uint64]) -> None:
    """Join the bytes of each word, which lie as far apart as there are words in the data."""
    b = data.reshape(BYTES, -1)[:, first : first + len(words)]
    b0, b1, b2, b3, b4, b5, b6, b7 = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]
    for i in range(len(words)):  # halves of 32 bits: these are joined several at once
        low = _joined(b0[i], b1[i], b2[i], b3[i])
        words[i] = np.uint64(low) | np.uint64(_joined(b4[i], b5[i], b6[i], b7[i])) << np.uint64(32)


@kernel
def _joined(b0: np.uint8, b1: np.uint8, b2: np.uint8, b3: np.uint8) -> np.uint32:
    """Join four bytes, the lowest first."""
    low = np.uint32(b0) | np.uint32(b1) << np.uint32(8)
    return low | np.uint32(b2) << np.uint32(16) | np.uint32(b3) << np.uint32(24)
