"""One camera's table of MVSEC's HDF5: its blocks, checked, sorted and read on request."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import h5py
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.base import Events
from gpvo.recordings.checks import columns
from gpvo.recordings.checks.plain_columns import fill_plain
from gpvo.recordings.checks.sensor_size import check_resolution
from gpvo.recordings.checks.time_order import (
    DISORDER_NS,
    FEWEST_AFTER_GAP,
    LONGEST_GAP_NS,
    SORTED,
)
from gpvo.recordings.files.mvsec_chunks import EventChunks
from gpvo.recordings.hdf5 import Column, H5Error, holds
from gpvo.recordings.pairing import OneCameraError
from gpvo.recordings.streams import Faults

TIME = 2
DISORDER = DISORDER_NS * 1e-9
"""Events that are late by less than this are sorted, seconds."""
LONGEST_GAP = LONGEST_GAP_NS * 1e-9
"""Fewer than FEWEST_AFTER_GAP events beyond so many seconds have damaged stamps."""
END_ROWS = 4096
"""Rows at the end of a table, among which the latest event is."""
BLOCK_ROWS, CACHED_ROWS = 1 << 19, 1 << 16
"""Rows of a block, and of it those that are read at once; a chunk at least."""


@dataclass(frozen=True)
class EventTable:
    """Event table of one camera, whose rows are read on request."""

    dataset: h5py.Dataset
    resolution: tuple[int, int]
    where: str

    @staticmethod
    def open(file: h5py.File, name: str, resolution: tuple[int, int]) -> EventTable:
        """Return a table of an open file; InputError if it is none of this sensor's events."""
        where = f"{file.filename}: {name}"
        if not holds(file, name):
            raise OneCameraError(f"{where} is missing; give MVSEC's *_data.hdf5 with both cameras")
        dataset = file[name]
        if not _is_event_table(dataset):
            raise InputError(f"{where} is not a table of N x 4 float64: x, y, seconds, polarity")
        if len(dataset) == 0:
            raise InputError(f"{where} holds no events; both cameras are needed")
        check_resolution(_stated_resolution(dataset, where), resolution, where)
        return EventTable(dataset, resolution, where)

    @cached_property
    def chunks(self) -> EventChunks | None:
        """Its chunks, if they are packed as MVSEC's are."""
        return EventChunks.of(self.dataset)

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """Columns x, y, time and polarity."""
        return tuple(Column(self.dataset, number) for number in range(4))

    def seconds(self, row: int) -> float:
        """Return the absolute time of one row in seconds."""
        time = self._times(row, row + 1)
        columns.check_times(time, -np.inf, self.where, row)
        return float(time[0])

    def span(self) -> tuple[float, float]:
        """Return the times of the first and the latest event in seconds."""
        last_row = len(self.dataset) - 1
        first, last = self.seconds(0), self.seconds(last_row)
        if last < first - DISORDER:
            raise InputError(
                f"{self.where} row {last_row}: time {last:.6f} s is before {first:.6f} s of"
                " row 0; sort the events by time"
            )
        ends = self._times(max(0, last_row - END_ROWS), last_row + 1)
        begins = self._times(0, min(END_ROWS, last_row + 1))
        self._check_ends(begins, ends)
        near = ends[np.abs(ends - last) < DISORDER], begins[np.abs(begins - first) < DISORDER]
        return float(near[1].min()), float(near[0].max())

    def _check_ends(self, begins: NDArray[np.float64], ends: NDArray[np.float64]) -> None:
        """Raise InputError if few of the first or last events are far from the others."""
        rows = len(self.dataset)
        if rows >= 2 * FEWEST_AFTER_GAP:
            self._check_end(begins[:FEWEST_AFTER_GAP], 0, "below")
            self._check_end(ends[-FEWEST_AFTER_GAP:], rows - FEWEST_AFTER_GAP, "above")

    def _check_end(self, times: NDArray[np.float64], first_row: int, side: str) -> None:
        gaps = np.diff(times)
        if np.count_nonzero(gaps > LONGEST_GAP) != 1:
            return  # with many of them the times' unit is another
        before_gap = int(np.argmax(gaps))
        bad = before_gap + (side == "above")
        raise InputError(
            f"{self.where} row {first_row + bad}: time {times[bad]:.6f} s is"
            f" {gaps[before_gap]:.0f} s from that of the row {side}, and few events are there:"
            " their stamps are damaged; leave them out"
        )

    def _times(self, first_row: int, stop_row: int) -> NDArray[np.float64]:
        """Return the times of rows in seconds."""
        return np.asarray(self.columns[TIME].rows(first_row, stop_row), np.float64)

    def blocks(self, origin: float, start: float, faults: Faults) -> Iterator[Events]:
        """Yield the checked events from `start` on, with times in seconds since `origin`.

        Those that are late by less than `DISORDER` are sorted and counted. The latest ones wait
        until the next block cannot hold earlier ones.
        """
        rows = range(len(self.dataset))
        row = self._first_after(origin + start - DISORDER)
        latest = -np.inf if row == 0 else self.seconds(row - 1)
        end, waiting = self.seconds(rows[-1]), list[Events]()
        for first_row, stop_row in pairwise([row, *self._ends(row, len(rows), BLOCK_ROWS)]):
            events, latest = self._block(first_row, stop_row, origin, latest, faults)
            if latest > end + DISORDER:
                # Times decrease further down, perhaps after the row where a reader stops.
                last_row = stop_row - 1
                raise InputError(
                    f"{self.where} row {rows[-1]}: time {end:.6f} s is before {latest:.6f} s of"
                    f" row {last_row}; sort the events by time"
                )
            parts, settled = _in_order(waiting, events), latest - origin - DISORDER
            yield from (part.between(start, settled) for part in parts)
            waiting = [rest for part in parts if len(rest := part.between(settled, np.inf))]
        yield from (part.between(start, np.inf) for part in waiting)

    def _first_after(self, time: float) -> int:
        """Return the first row that is not before an absolute time in seconds."""
        if self.seconds(0) >= time:
            return 0  # a bisection unpacks a chunk per step
        return bisect_left(range(len(self.dataset)), time, key=self.seconds)

    def _ends(self, row: int, stop: int, rows: int) -> list[int]:
        """Return where parts of so many rows end: with chunks, so that each is unpacked once."""
        chunk = self.dataset.chunks[0] if self.dataset.chunks else 1
        size = chunk * max(1, rows // chunk)
        return [*range(row - row % size + size, stop, size), stop]

    def _block(
        self, first_row: int, stop_row: int, origin: float, latest: float, faults: Faults
    ) -> tuple[Events, float]:
        """Return the events of one block, in order of time, and the latest time so far."""
        plain = self._plain_block(first_row, stop_row, origin, latest)
        if plain is not None:
            return plain
        x, y, seconds, polarity = self._columns(first_row, stop_row)
        in_order = np.maximum.accumulate(np.append(latest, seconds))
        late = in_order[:-1] - seconds
        small = late < DISORDER
        faults[SORTED] += int((small & (late > 0)).sum())
        columns.check_times(np.where(small, in_order[1:], seconds), latest, self.where, first_row)
        width, height = self.resolution
        events = Events(
            columns.pixels(x, width, "x", self.where, first_row),
            columns.pixels(y, height, "y", self.where, first_row),
            seconds - origin,
            columns.polarities(polarity, self.where, first_row),
        )
        return _sorted(events), float(in_order[-1])

    def _plain_block(
        self, first_row: int, stop_row: int, origin: float, latest: float
    ) -> tuple[Events, float] | None:
        """Return the same of a block without faults, None for any; see `fill_plain`.

        Columns are read some rows at a time, which stay in the processor's cache meanwhile.
        """
        events = Events.empty(stop_row - first_row)
        given = self.resolution, origin, latest
        last = None if self.chunks is None else self.chunks.fill(events, first_row, *given)
        if last is not None:
            return events, last
        for first, stop in pairwise([first_row, *self._ends(first_row, stop_row, CACHED_ROWS)]):
            part = events[first - first_row : stop - first_row]
            x, y, t, polarity = self._columns(first, stop)
            if not fill_plain(part, x, y, t, polarity, self.resolution, origin, latest):
                return None
            latest = float(t[-1])
        return events, latest

    def _columns(self, first_row: int, stop_row: int) -> tuple[NDArray[np.float64], ...]:
        """Return the columns of one block: a third faster than whole rows on MVSEC's chunks."""
        rows = (column.rows(first_row, stop_row) for column in self.columns)
        return tuple(np.asarray(one, np.float64) for one in rows)


def _in_order(waiting: list[Events], events: Events) -> list[Events]:
    """Return events in order of time, in parts; those of one time keep their order."""
    if not waiting or events.t[0] >= waiting[-1].t[-1]:
        return [*waiting, events]
    return [_sorted(Events.concatenate([*waiting, events]))]


def _sorted(events: Events) -> Events:
    return events[np.argsort(events.t, kind="stable")]


def _is_event_table(item: h5py.Dataset | h5py.Group) -> bool:
    if not isinstance(item, h5py.Dataset) or item.dtype.newbyteorder("=") != np.dtype(float):
        return False
    return item.shape is not None and item.ndim == 2 and item.shape[1] == 4


def _stated_resolution(dataset: h5py.Dataset, where: str) -> tuple[int, ...] | None:
    """Return the width and height that a dataset may state."""
    try:
        stated = tuple(int(dataset.attrs.get(name, 0)) for name in ("width", "height"))
    except (*H5Error, TypeError) as error:
        raise InputError(f"{where} has attributes width and height that are no numbers") from error
    return stated if any(stated) else None
