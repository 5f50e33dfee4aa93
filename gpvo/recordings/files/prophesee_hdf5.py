"""Read Prophesee's HDF5: a table of events, CD/events, usually packed by its own filter ECF."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.files.hdf5_rows import Rows, RowStream
from gpvo.recordings.gzip_chunks import filters_of
from gpvo.recordings.hdf5 import Column, H5Error
from gpvo.recordings.streams import EventBlock

EVENTS = "CD/events"
ECF = 0x8ECF


class TableStream(RowStream):
    """Event stream of one camera in a table of x, y, p and t, microseconds.

    Raises
    ------
    InputError
        If it is no such table, or is packed by ECF and Prophesee's plugin is missing.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, f"{path}: {EVENTS}")

    def _rows_of(self, file: h5py.File) -> Rows:
        table = file[EVENTS]
        if not _is_table(table):
            raise InputError(f"{self.where} is not a table of x, y, p and t")
        if _is_packed_by_ecf(table) and not h5py.h5z.filter_avail(ECF):
            raise InputError(
                f"{self.where} is packed by Prophesee's ECF; set HDF5_PLUGIN_PATH to the folder"
                " of their plugin (github.com/prophesee-ai/hdf5_ecf), or open the raw file that"
                " it was made from"
            )
        return _Table(Column(table))


@dataclass(frozen=True)
class _Table(Rows):
    """The open table of one camera."""

    table: Column

    def __len__(self) -> int:
        return len(self.table)

    def block(self, first: int, stop: int) -> EventBlock:
        rows = self.table.rows(first, stop)
        x, y = (rows[name].astype(np.uint16) for name in "xy")
        return EventBlock(x, y, rows["t"].astype(np.int64) * 1000, rows["p"] > 0)

    def stamp(self, row: int) -> int:
        return int(self.table.rows(row, row + 1)["t"][0]) * 1000


def _is_table(item: h5py.Dataset | h5py.Group) -> bool:
    if not isinstance(item, h5py.Dataset) or item.shape is None or item.ndim != 1:
        return False
    kinds = {name: item.dtype[name].kind for name in item.dtype.names or ()}
    return all(kinds.get(name) in ("i", "u") for name in "xypt")


def _is_packed_by_ecf(table: h5py.Dataset) -> bool:
    try:
        return ECF in filters_of(table)
    except H5Error:
        return False
