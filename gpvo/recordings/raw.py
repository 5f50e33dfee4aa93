"""Pairs of Prophesee's raw files, EVT2 and EVT3."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.evt import WRAP_US, Evt2, Evt3
from gpvo.recordings.streams import EventBlock, EventStream, Faults

DECODERS: dict[str, type[Evt3] | type[Evt2]] = {"3.0": Evt3, "2.0": Evt2}
BLOCK_BYTES = 1 << 20
LONGEST_HEADER = 1 << 16


def is_raw(path: Path) -> bool:
    """Whether a file begins with Prophesee's header of lines with a percent sign."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(LONGEST_HEADER)
    return head.startswith(b"% ") and (b"% evt " in head or b"% format EVT" in head)


class RawStream(EventStream):
    """A raw file; its stamps are the sensor's.

    Raises
    ------
    InputError
        If it is in a format other than EVT2 and EVT3.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.where = path, str(path)
        header, self._start = _header(path)
        self._decoder = DECODERS[_version(path, header)]
        self.resolution = _geometry(header)
        self.wrap_ns = WRAP_US * 1000 if self._decoder is Evt3 else 1000 << 34

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        decoder = self._decoder()
        size = decoder.word.itemsize
        with self.path.open("rb") as file:
            file.seek(self._start)
            while data := file.read(BLOCK_BYTES):
                yield from decoder.decode(
                    np.frombuffer(data[: len(data) // size * size], decoder.word)
                )

    def ends(self) -> Iterator[EventBlock]:
        """The last event of EVT3, after a walk over the times only; the last block of EVT2."""
        decoder = self._decoder()
        with self.path.open("rb") as file:
            if isinstance(decoder, Evt3):
                file.seek(self._start)
                while data := file.read(BLOCK_BYTES):
                    decoder.skip(np.frombuffer(data[: len(data) // 2 * 2], decoder.word))
                yield decoder.last_event()
            else:
                size = (self.path.stat().st_size - self._start) // 4 * 4
                file.seek(self._start + max(0, size - BLOCK_BYTES))
                words = np.frombuffer(file.read(min(size, BLOCK_BYTES)), decoder.word)
                yield from decoder.decode(words)


def _header(path: Path) -> tuple[str, int]:
    """The lines of the header and where the events begin."""
    lines: list[str] = []
    with path.open("rb") as file:
        while True:
            at = file.tell()
            if file.read(2) != b"% ":
                return "\n".join(lines), at
            lines.append(file.readline(LONGEST_HEADER).decode(errors="replace").strip())
            if lines[-1] == "end":
                return "\n".join(lines), file.tell()


def _version(path: Path, header: str) -> str:
    """2.0 or 3.0."""
    found = re.search(r"^evt (\S+)", header, re.M) or re.search(
        r"^format EVT(\S+?)(?:;|$)", header, re.M
    )
    version = found.group(1) if found else "unknown"
    version = version if "." in version else f"{version}.0"
    if version not in DECODERS:
        raise InputError(
            f"{path}: is in EVT {version}; gpvo reads EVT 2.0 and 3.0: set the"
            " camera to one of them and record again"
        )
    return version


def _geometry(header: str) -> tuple[int, int] | None:
    found = re.search(r"^geometry (\d+)x(\d+)$", header, re.M)
    if found:
        return int(found.group(1)), int(found.group(2))
    height, width = re.search(r"height=(\d+)", header), re.search(r"width=(\d+)", header)
    return (int(width.group(1)), int(height.group(1))) if width and height else None
