"""Event streams of one camera whose events are the rows of an HDF5 file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from gpvo.recordings.hdf5 import open_hdf5
from gpvo.recordings.streams import EventBlock, EventStream, Faults

BLOCK_ROWS = 1 << 19
LAST_ROWS = 1 << 14


class Rows(ABC):
    """Rows of an open file, one for each event."""

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def block(self, first: int, stop: int) -> EventBlock:
        """Return the events of rows first to stop - 1."""

    @abstractmethod
    def stamp(self, row: int) -> int:
        """Return the stamp of a row, nanoseconds."""

    def first_row(self, start_ns: int) -> int:
        """Return the first row from a stamp on."""
        return bisect_left(range(len(self)), start_ns, key=self.stamp)


class RowStream(EventStream):
    """Event stream of one camera in rows; none is read before it is asked for."""

    def __init__(self, path: Path, where: str) -> None:
        self.path, self.where = path, where
        with self._open() as rows:
            self.rows = len(rows)

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        with self._open() as rows:
            first = 0 if start_ns is None else rows.first_row(start_ns)
            for row in range(first, self.rows, BLOCK_ROWS):
                yield rows.block(row, min(row + BLOCK_ROWS, self.rows))

    def ends(self) -> Iterator[EventBlock]:
        if self.rows:
            with self._open() as rows:
                yield rows.block(max(0, self.rows - LAST_ROWS), self.rows)

    @contextmanager
    def _open(self) -> Iterator[Rows]:
        with open_hdf5(self.path) as file:
            yield self._rows_of(file)

    @abstractmethod
    def _rows_of(self, file: h5py.File) -> Rows:
        """Return the rows of an open file; raise InputError if it has none of this kind."""
