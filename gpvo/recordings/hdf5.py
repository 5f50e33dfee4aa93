"""HDF5 with errors that a user understands; nothing of a dataset is read before it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import hdf5plugin  # noqa: F401  registers the compressions that event cameras' files use
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError

CHUNK_CACHE_BYTES = 1 << 24
"""Keeps the chunk of a bisection, or one that two blocks share, from being unpacked twice."""

H5Error = (OSError, KeyError, RuntimeError, ValueError)
"""What h5py raises where a file's bytes are damaged."""


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading; InputError if it is damaged or cut short."""
    try:
        file = h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE_BYTES)
    except H5Error as error:
        raise InputError(
            f"{path}: this HDF5 file is cut short or damaged; copy or download it again"
        ) from error
    with file:
        yield file


def holds(file: h5py.File, name: str) -> bool:
    """Whether a group or dataset of that name can be opened."""
    try:
        return file.get(name) is not None
    except H5Error:
        return False


def read_column(
    dataset: h5py.Dataset, column: int, first_row: int, stop_row: int
) -> NDArray[np.float64]:
    """Rows first_row to stop_row - 1 of one column, float64; InputError if they are damaged."""
    try:
        return np.asarray(dataset[first_row:stop_row, column], np.float64)
    except H5Error as error:
        raise InputError(
            f"{dataset.file.filename}: {dataset.name.strip('/')} cannot be read from row"
            f" {first_row} to {stop_row - 1}; the file is damaged or packed by an unknown filter:"
            " copy or download it again"
        ) from error
