"""Write MVSEC's and DSEC's HDF5."""

from __future__ import annotations

from pathlib import Path

import h5py
import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from gpvo.recordings.base import SIDES
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.disk_file import DiskFile
from gpvo.recordings.writing.writer import RecordingWriter, Sizes, microseconds

CHUNK_ROWS = 1 << 16

GZIP = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
"""Readable by h5py without further filters; as small as Blosc and written as fast."""


class _Hdf5File:
    """An HDF5 file that is being written; `check` and `close` raise OSError if it could not be."""

    def __init__(self, path: Path) -> None:
        self._disk = DiskFile(path)
        self.file = h5py.File(self._disk, "w")

    def check(self) -> None:
        self._disk.check()

    def close(self) -> None:
        self.file.close()
        self._disk.close()
        self._disk.check()


class MvsecWriter(RecordingWriter):
    """Writer of davis/{left,right}/events, (N, 4) float64: x, y, seconds, polarity -1 or 1."""

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        self._hdf5 = _Hdf5File(path)
        self._tables = [
            self._hdf5.file.create_dataset(
                f"davis/{side}/events",
                shape=(0, 4),
                maxshape=(None, 4),
                dtype=np.float64,
                chunks=(CHUNK_ROWS, 1),
                **GZIP,
            )
            for side in SIDES[: len(sizes)]
        ]

    def append(self, *blocks: EventBlock) -> None:
        for table, block in zip(self._tables, blocks, strict=True):
            polarity = np.where(block.polarity, 1.0, -1.0)
            seconds = microseconds(block.t_ns) / 1e6
            _extend(table, np.column_stack([block.x, block.y, seconds, polarity]))
        self._hdf5.check()

    def close(self) -> None:
        self._hdf5.close()


class DsecWriter(RecordingWriter):
    """Writer of a folder with events/{left,right}/events.h5: columns, t_offset and ms_to_idx."""

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        offset_us = start_ns // 1000
        self._files = [
            _DsecFile(path / "events" / side / "events.h5", offset_us)
            for side in SIDES[: len(sizes)]
        ]

    def append(self, *blocks: EventBlock) -> None:
        for file, block in zip(self._files, blocks, strict=True):
            file.append(block)

    def close(self) -> None:
        for file in self._files:
            file.close()


class _DsecFile:
    """File of one camera."""

    def __init__(self, path: Path, offset_us: int) -> None:
        path.parent.mkdir(parents=True)
        self._hdf5, self._offset_us = _Hdf5File(path), offset_us
        self._hdf5.file["t_offset"] = np.int64(offset_us)
        # DSEC's own uint32 microseconds overflow after 71 minutes; readers accept int64, too.
        kinds = {"x": np.uint16, "y": np.uint16, "t": np.int64, "p": np.uint8}
        self._columns = {name: self._column(f"events/{name}", kinds[name]) for name in kinds}
        self._index = self._column("ms_to_idx", np.uint64)

    def append(self, block: EventBlock) -> None:
        t = microseconds(block.t_ns) - self._offset_us
        self._append_index(t, len(self._columns["t"]))
        values = {"x": block.x, "y": block.y, "t": t, "p": block.polarity}
        for name, column in self._columns.items():
            _extend(column, values[name])
        self._hdf5.check()

    def _append_index(self, t: NDArray[np.int64], rows: int) -> None:
        """Append the first row of every millisecond up to that of the last event."""
        if len(t) == 0:
            return
        milliseconds = np.arange(len(self._index), t[-1] // 1000 + 1)
        _extend(self._index, rows + np.searchsorted(t, 1000 * milliseconds, side="left"))

    def _column(self, name: str, kind: type) -> h5py.Dataset:
        return self._hdf5.file.create_dataset(
            name,
            shape=(0,),
            maxshape=(None,),
            dtype=kind,
            chunks=(CHUNK_ROWS,),
            **hdf5plugin.Blosc(cname="zstd"),
        )

    def close(self) -> None:
        self._hdf5.close()


def _extend(dataset: h5py.Dataset, values: NDArray) -> None:
    rows = len(dataset)
    dataset.resize(rows + len(values), axis=0)
    dataset[rows:] = values
