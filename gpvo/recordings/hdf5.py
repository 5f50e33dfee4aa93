"""Read HDF5 with errors that a user understands; only the requested rows are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin  # noqa: F401  registers the compressions that event cameras' files use
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.gzip_chunks import GzipChunks

CHUNK_CACHE_BYTES = 1 << 24
"""Bytes; a chunk used by a bisection or by two blocks is unpacked only once."""

H5Error = (OSError, KeyError, RuntimeError, ValueError)
"""Errors that h5py raises if a file is damaged."""


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading; raise InputError if it is damaged or cut short."""
    try:
        file = h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE_BYTES)
    except H5Error as error:
        raise InputError(
            f"{path}: this HDF5 file is cut short or damaged; copy or download it again"
        ) from error
    with file:
        yield file


def holds(file: h5py.File, name: str) -> bool:
    """Return whether a group or dataset of this name can be opened."""
    try:
        return file.get(name) is not None
    except H5Error:
        return False


class Column:
    """A column of a dataset, or a dataset of one column, whose rows are read on request."""

    def __init__(self, dataset: h5py.Dataset, column: int | None = None) -> None:
        self._dataset, self._column = dataset, column
        self._chunks = GzipChunks.of(dataset, column)

    def __len__(self) -> int:
        return len(self._dataset)

    def rows(self, first_row: int, stop_row: int) -> NDArray[Any]:
        """Return rows first_row to stop_row - 1; raise InputError if they are damaged."""
        found = None if self._chunks is None else self._chunks.rows(first_row, stop_row)
        return np.asarray(self._read(first_row, stop_row)) if found is None else found

    def _read(self, first_row: int, stop_row: int) -> Any:
        columns = () if self._column is None else (self._column,)
        try:
            return self._dataset[(slice(first_row, stop_row), *columns)]
        except H5Error as error:
            name = self._dataset.name.strip("/")
            raise InputError(
                f"{self._dataset.file.filename}: {name} cannot be read from row {first_row} to"
                f" {stop_row - 1}; the file is damaged or packed by an unknown filter: copy or"
                " download it again"
            ) from error


def has_dataset(path: Path, name: str) -> bool:
    """Return whether a path is an HDF5 file with this dataset; raise InputError if damaged."""
    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    with open_hdf5(path) as file:
        return holds(file, name)
