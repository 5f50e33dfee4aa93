"""Read Prophesee's HDF5: a table of events, CD/events, usually packed by its own filter ECF."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.hdf5 import H5Error, open_hdf5, read_rows
from gpvo.recordings.streams import EventBlock, EventStream, Faults

EVENTS = "CD/events"
ECF = 0x8ECF
BLOCK_ROWS = 1 << 19
LAST_ROWS = 1 << 14


class TableStream(EventStream):
    """Event stream of one camera in a table of x, y, p and t, microseconds.

    Raises
    ------
    InputError
        If it is no such table, or is packed by ECF and Prophesee's plugin is missing.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.where = path, f"{path}: {EVENTS}"
        with self._open() as table:
            self._rows = len(table)

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        with self._open() as table:
            first = 0
            if start_ns is not None:
                rows = range(self._rows)
                first = bisect_left(rows, start_ns, key=lambda row: _stamp(table, row))
            for row in range(first, self._rows, BLOCK_ROWS):
                yield _block(table, row, min(row + BLOCK_ROWS, self._rows))

    def ends(self) -> Iterator[EventBlock]:
        if self._rows:
            with self._open() as table:
                yield _block(table, max(0, self._rows - LAST_ROWS), self._rows)

    @contextmanager
    def _open(self) -> Iterator[h5py.Dataset]:
        with open_hdf5(self.path) as file:
            table = file[EVENTS]
            if not _is_table(table):
                raise InputError(f"{self.where} is not a table of x, y, p and t")
            if _is_packed_by_ecf(table) and not h5py.h5z.filter_avail(ECF):
                raise InputError(
                    f"{self.where} is packed by Prophesee's ECF; set HDF5_PLUGIN_PATH to the folder"
                    " of their plugin (github.com/prophesee-ai/hdf5_ecf), or open the raw file that"
                    " it was made from"
                )
            yield table


def _is_table(item: h5py.Dataset | h5py.Group) -> bool:
    if not isinstance(item, h5py.Dataset) or item.shape is None or item.ndim != 1:
        return False
    kinds = {name: item.dtype[name].kind for name in item.dtype.names or ()}
    return all(kinds.get(name) in ("i", "u") for name in "xypt")


def _is_packed_by_ecf(table: h5py.Dataset) -> bool:
    try:
        properties = table.id.get_create_plist()
        filters = range(properties.get_nfilters())
        return any(properties.get_filter(number)[0] == ECF for number in filters)
    except H5Error:
        return False


def _block(table: h5py.Dataset, first: int, stop: int) -> EventBlock:
    rows = read_rows(table, first, stop)
    x, y = (rows[name].astype(np.uint16) for name in "xy")
    return EventBlock(x, y, rows["t"].astype(np.int64) * 1000, rows["p"] > 0)


def _stamp(table: h5py.Dataset, row: int) -> int:
    return int(read_rows(table, row, row + 1)["t"][0]) * 1000
