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
from gpvo.recordings.gzip_chunks import unpacked_rows

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


def read_column(
    dataset: h5py.Dataset, column: int, first_row: int, stop_row: int
) -> NDArray[np.float64]:
    """Return rows first_row to stop_row - 1 of one column, float64; InputError if damaged."""
    found = unpacked_rows(dataset, first_row, stop_row, column)
    if found is None:
        found = _read(dataset, (slice(first_row, stop_row), column))
    return np.asarray(found, np.float64)


def read_rows(dataset: h5py.Dataset, first_row: int, stop_row: int) -> NDArray[Any]:
    """Return rows first_row to stop_row - 1 of a dataset; raise InputError if damaged."""
    found = unpacked_rows(dataset, first_row, stop_row)
    return np.asarray(_read(dataset, (slice(first_row, stop_row),))) if found is None else found


def _read(dataset: h5py.Dataset, selection: tuple[Any, ...]) -> Any:
    try:
        return dataset[selection]
    except H5Error as error:
        rows = selection[0]
        raise InputError(
            f"{dataset.file.filename}: {dataset.name.strip('/')} cannot be read from row"
            f" {rows.start} to {rows.stop - 1}; the file is damaged or packed by an unknown filter:"
            " copy or download it again"
        ) from error


def has_dataset(path: Path, name: str) -> bool:
    """Return whether a path is an HDF5 file with this dataset; raise InputError if damaged."""
    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    with open_hdf5(path) as file:
        return holds(file, name)
