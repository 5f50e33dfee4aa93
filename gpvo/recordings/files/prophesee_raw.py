"""Read Prophesee's raw files: EVT2, EVT2.1 and EVT3."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.decoders import evt2, evt3
from gpvo.recordings.decoders.evt2 import Evt2, Evt21, looks_legacy
from gpvo.recordings.decoders.evt3 import Evt3
from gpvo.recordings.streams import EventBlock, EventStream, Faults

VERSIONS = {"2": "2.0", "2.0": "2.0", "2.1": "2.1", "21": "2.1", "3": "3.0", "3.0": "3.0"}
"""Versions as written in the header's lines `evt` and `format`."""

Decoder = Evt2 | Evt21 | Evt3
BLOCK_BYTES = 1 << 20
LONGEST_HEADER = 1 << 16
LONGEST_BACK_NS = 60_000_000_000
"""Nanoseconds; a file that ends earlier than it begins by more has a wrap of its clock in it."""


def is_raw(path: Path) -> bool:
    """Return whether a file begins with Prophesee's header, lines with a percent sign."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(LONGEST_HEADER)
    return head.startswith(b"% ") and (b"% evt " in head or b"% format EVT" in head)


class RawStream(EventStream):
    """Event stream of a raw file, whose stamps are sensor times.

    Raises
    ------
    InputError
        If it is in a format other than EVT2, EVT2.1 and EVT3.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.where = path, str(path)
        header, self._start = _header(path)
        self._version, self._legacy = _version(path, header), False
        if self._version == "2.1":
            self._legacy = self._is_legacy(header)
        self.resolution = _geometry(header)
        self.wrap_ns = 1000 * (evt3.WRAP_US if self._version == "3.0" else evt2.WRAP_US)

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        decoder = self._decoder()
        for words in self._words(decoder):
            yield from decoder.decode(words)

    def ends(self) -> Iterator[EventBlock]:
        """Yield the last event of EVT3, found by reading only the times; else the last block."""
        decoder = self._decoder()
        if isinstance(decoder, Evt3):
            for words in self._words(decoder):
                decoder.skip(words)
            yield decoder.last_event()
        else:
            size = self.path.stat().st_size - self._start
            size -= size % decoder.word.itemsize
            first = next(self.blocks(None, Faults()), None)
            for words in self._words(decoder, max(0, size - BLOCK_BYTES)):
                for block in decoder.decode(words):
                    yield self._after(first or block, block)

    def _after(self, first: EventBlock, block: EventBlock) -> EventBlock:
        """Return a block of the end with the wrap of the clock that is between it and the first."""
        if np.median(first.t_ns) - np.median(block.t_ns) < LONGEST_BACK_NS:
            return block
        return EventBlock(block.x, block.y, block.t_ns + self.wrap_ns, block.polarity)

    def _decoder(self) -> Decoder:
        if self._version == "2.1":
            return Evt21(self._legacy)
        return Evt3() if self._version == "3.0" else Evt2()

    def _words(self, decoder: Decoder, skipped: int = 0) -> Iterator[NDArray[Any]]:
        """Yield the file's whole words in blocks."""
        with self.path.open("rb") as file:
            file.seek(self._start + skipped)
            while data := file.read(BLOCK_BYTES):
                whole = len(data) - len(data) % decoder.word.itemsize
                yield np.frombuffer(data[:whole], decoder.word)

    def _is_legacy(self, header: str) -> bool:
        """Return whether EVT2.1's words are legacy ones; older headers do not state it."""
        if stated := re.search(r"endianness=(\w+)", header):
            return stated.group(1) == "legacy"
        return looks_legacy(next(self._words(Evt21()), np.empty(0, Evt21.word)))


def _header(path: Path) -> tuple[str, int]:
    """Return the lines of the header and the position where the events begin."""
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
    """Return the version of EVT: 2.0, 2.1 or 3.0."""
    found = re.search(r"^evt (\S+)", header, re.M) or re.search(
        r"^format EVT([^;\s]+)", header, re.M
    )
    version = found.group(1) if found else "unknown"
    if version not in VERSIONS:
        raise InputError(
            f"{path}: is in EVT {version}; gpvo reads EVT 2.0, 2.1 and 3.0: set the camera to one"
            " of them and record again"
        )
    return VERSIONS[version]


def _geometry(header: str) -> tuple[int, int] | None:
    found = re.search(r"^geometry (\d+)x(\d+)$", header, re.M)
    if found:
        return int(found.group(1)), int(found.group(2))
    height, width = re.search(r"height=(\d+)", header), re.search(r"width=(\d+)", header)
    return (int(width.group(1)), int(height.group(1))) if width and height else None
