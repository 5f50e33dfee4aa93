"""A file that HDF5 can be written through, also where the disk takes no more."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any


class DiskFile(io.FileIO):
    """File for h5py that keeps the first failure to write for `check`.

    HDF5's own files crash the process when what could not be written is closed.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of the data, or nothing more after a failure."""
        rest = memoryview(data)
        try:
            while self._failure is None and len(rest):
                rest = rest[super().write(rest) :]
        except OSError as error:
            self._failure = error
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        """Set the file's size, if nothing has failed."""
        try:
            return super().truncate(size) if self._failure is None else 0
        except OSError as error:
            self._failure = error
            return 0

    def check(self) -> None:
        """Raise OSError if something could not be written."""
        if self._failure is not None:
            raise self._failure
