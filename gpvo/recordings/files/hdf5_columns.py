"""Read HDF5 with one dataset per event column: DSEC, TUM-VIE, VECtor, M3ED, event_utils."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.checks.time_unit import check_since_1970
from gpvo.recordings.files.hdf5_rows import Rows, RowStream
from gpvo.recordings.hdf5 import Column, H5Error, holds, open_hdf5
from gpvo.recordings.streams import EventBlock, nanoseconds

FIRST_ROWS = 1000
"""Rows of which the times are looked at, as single ones may be damaged."""


@dataclass(frozen=True)
class Layout:
    """Names of a camera's datasets; float times are seconds, others microseconds."""

    x: str
    y: str
    t: str
    polarity: str
    index: str
    offset: str

    @staticmethod
    def of(group: str, names: str = "xytp", index: str = "ms_to_idx") -> Layout:
        """Return the layout of columns x, y, t, p (or xs, ys, ts, ps) in a group."""
        plural = "s" if names.endswith("s") else ""
        x, y, t, polarity = (f"{group}/{column}{plural}" for column in "xytp")
        return Layout(x, y, t, polarity, index, "t_offset")


DSEC = Layout.of("events")
EVENT_UTILS = Layout.of("events", "s")
M3ED = {
    side: Layout.of(f"prophesee/{side}", index=f"prophesee/{side}/ms_map_idx")
    for side in ("left", "right")
}


class ColumnStream(RowStream):
    """Event stream of one camera in columns.

    Raises
    ------
    InputError
        If a column is missing, differs in length from the others, or does not hold numbers, or
        if times have another unit.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self._layout = layout
        super().__init__(path, f"{path}: {layout.x.rpartition('/')[0]}")
        with open_hdf5(path) as file:
            t = file[layout.t]
            self.time_unit = "seconds" if t.dtype.kind == "f" else "microseconds"
            if len(t):
                first = float(np.median(Column(t).rows(0, min(len(t), FIRST_ROWS))))
                check_since_1970(first, self.time_unit, f"{path}: {layout.t}")

    def _rows_of(self, file: h5py.File) -> Rows:
        return _Columns.of(file, self._layout, self.where)


@dataclass(frozen=True)
class _Columns(Rows):
    """Open datasets of one camera."""

    x: Column
    y: Column
    t: Column
    polarity: Column
    index: Column | None
    offset_ns: int

    @staticmethod
    def of(file: h5py.File, layout: Layout, where: str) -> _Columns:
        names = (layout.x, layout.y, layout.t, layout.polarity)
        x, y, t, polarity = (_column(file, name, where) for name in names)
        lengths = [len(column) for column in (x, y, t, polarity)]
        if len(set(lengths)) > 1:
            raise InputError(
                f"{where}: its columns have different lengths, {lengths}; copy the file again"
            )
        index = file[layout.index] if holds(file, layout.index) else None
        offset_ns = 1000 * _scalar(file, layout.offset, where)
        return _Columns(x, y, t, polarity, _usable_index(index), offset_ns)

    def __len__(self) -> int:
        return len(self.t)

    def block(self, first: int, stop: int) -> EventBlock:
        return EventBlock(
            _pixels(self.x.rows(first, stop)),
            _pixels(self.y.rows(first, stop)),
            self._stamps(self.t.rows(first, stop)),
            self.polarity.rows(first, stop) > 0,
        )

    def first_row(self, start_ns: int) -> int:
        """Return the first row from a stamp on, by the file's index if it has a valid one."""
        millisecond = (start_ns - self.offset_ns) // 1_000_000
        if self.index is not None and 0 <= millisecond < len(self.index):
            row = int(self.index.rows(millisecond, millisecond + 1)[0])
            edge_ns = self.offset_ns + 1_000_000 * millisecond
            if 0 <= row <= len(self) and self._splits(row, edge_ns):
                return row
        return super().first_row(start_ns)

    def _splits(self, row: int, edge_ns: int) -> bool:
        """Return whether the rows before `row`, and only they, are earlier than `edge_ns`."""
        starts = row == len(self) or self.stamp(row) >= edge_ns
        return starts and (row == 0 or self.stamp(row - 1) < edge_ns)

    def stamp(self, row: int) -> int:
        return int(self._stamps(self.t.rows(row, row + 1))[0])

    def _stamps(self, times: NDArray[Any]) -> NDArray[np.int64]:
        if times.dtype.kind == "f":
            return nanoseconds(np.nan_to_num(times.astype(np.float64), nan=9e9)) + self.offset_ns
        stamps = np.multiply(times, 1000, dtype=np.int64, casting="unsafe")
        stamps += self.offset_ns
        return stamps


def _column(file: h5py.File, name: str, where: str) -> Column:
    if not holds(file, name) or not isinstance(file[name], h5py.Dataset):
        raise InputError(f"{where}: {name} is missing; the file is not complete")
    column = file[name]
    if column.shape is None or column.ndim != 1 or column.dtype.kind not in "biuf":
        raise InputError(f"{where}: {name} is not a column of numbers")
    return Column(column)


def _usable_index(index: Any) -> Column | None:
    fits = isinstance(index, h5py.Dataset) and index.ndim == 1 and index.dtype.kind in "iu"
    return Column(index) if fits else None


def _scalar(file: h5py.File, name: str, where: str) -> int:
    """Return a number, which may be in an array of one; 0 if there is none."""
    if not holds(file, name):
        return 0
    try:
        values = np.ravel(file[name][()])
        return int(values[0])
    except (*H5Error, TypeError, IndexError) as error:
        raise InputError(f"{where}: {name} is not a number of microseconds") from error


def _pixels(values: NDArray[Any]) -> NDArray[np.uint16]:
    """Return uint16 pixels; values that do not fit become 65535, outside of every sensor."""
    if values.dtype == np.uint16:
        return values
    with np.errstate(invalid="ignore"):
        whole = values.astype(np.int64)
    return np.where((whole < 0) | (whole > 65535), 65535, whole).astype(np.uint16)
