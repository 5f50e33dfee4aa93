"""Read MCAP files, alone or in a ROS 2 bag, even if they were never finished.

As with ROS 1 bags, the chunks are found by walking through the file, so the summary at its end
may be missing. The mcap library, used for writing, stops at the first damage: it reads nothing of
a file that is cut short, and half of a file with a single wrong byte.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple
from zlib import crc32

from gpvo.errors import InputError
from gpvo.recordings.bags.message_log import MessageLog, Topic
from gpvo.recordings.compression import DamagedChunkError, UnpackedChunks, unpack
from gpvo.recordings.streams import DAMAGED, Faults

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 3, 4, 5, 6, 15
ENCODINGS = ("ros1", "cdr")
LARGEST_RECORD = 1 << 24
"""Bytes of a schema or channel; a larger size is a sign of damage."""

_OP = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")


def is_mcap(path: Path) -> bool:
    """Return whether a file begins with the magic bytes of MCAP."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


class _Part(NamedTuple):
    """A chunk, or a message outside of chunks (compression "none")."""

    at: int
    stored: int
    size: int
    compression: str
    crc: int


class _DamagedError(Exception):
    pass


@dataclass
class McapFile(MessageLog):
    """An MCAP file with ROS 1 or CDR messages.

    Raises
    ------
    InputError
        If it holds no topic that can be read.
    """

    name = "MCAP"

    path: Path
    topics: dict[str, Topic] = field(init=False, default_factory=dict)
    notes: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self._parts: list[_Part] = []
        self._numbers: dict[str, set[int]] = {}
        self._schemas: dict[int, str] = {0: ""}
        self._unpacked_chunks = UnpackedChunks()
        with self.path.open("rb") as file:
            self._walk(file)
            if not self.topics:
                self._find_topics_in_chunks(file)
        if not self.topics:
            raise InputError(f"{self.path}: holds no topics; record it again")

    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        wanted = self._numbers[topic]
        with self.path.open("rb") as file:
            for part in reversed(self._parts) if backwards else self._parts:
                found = self._messages_of(file, part, wanted, faults)
                yield from reversed(list(found)) if backwards else found

    def _messages_of(
        self, file: BinaryIO, part: _Part, wanted: set[int], faults: Faults
    ) -> Iterator[memoryview]:
        try:
            if part.compression in ("", "none"):
                data = _unpacked(file, part)
            else:
                data = self._unpacked_chunks.get(part.at, lambda: _unpacked(file, part))
            view = memoryview(data)
            for operation, start, stop in _records(data):
                if operation != MESSAGE or stop < start + 22:
                    continue
                if int.from_bytes(view[start : start + 2], "little") in wanted:
                    yield view[start + 22 : stop]
        except (DamagedChunkError, _DamagedError):
            faults[DAMAGED] += 1

    def _walk(self, file: BinaryIO) -> None:
        """Find all parts that may hold messages, and the channels outside of chunks."""
        file.seek(0, 2)
        end = file.tell()
        at = len(MAGIC)
        try:
            while at < end - len(MAGIC):
                at = self._record(file, at, end)
        except (_DamagedError, struct.error, UnicodeDecodeError):
            at = min(at, end)
        file.seek(end - len(MAGIC))
        if at != end - len(MAGIC) or file.read() != MAGIC:
            self.notes.append(
                f"{self.path}: the file is cut short or damaged, {(end - at) / end:.1%} of it"
                " cannot be read; copy it again, or go on with what is intact"
            )

    def _record(self, file: BinaryIO, at: int, end: int) -> int:
        file.seek(at)
        operation, size = _OP.unpack(file.read(9))
        start = at + 9
        if operation == CHUNK:
            self._parts.append(_chunk(file, start, min(size, end - start)))
        elif operation == MESSAGE:
            self._parts.append(_Part(at, min(9 + size, end - at), 0, "none", 0))
        if start + size > end:
            raise _DamagedError
        if operation in (SCHEMA, CHANNEL):
            if size > LARGEST_RECORD:
                raise _DamagedError
            self._definition(operation, file.read(size))
        return start + int(size)

    def _definition(self, operation: int, data: bytes) -> None:
        if operation == SCHEMA:
            number = struct.unpack_from("<H", data)[0]
            self._schemas[number] = _string(data, 2)[0]
            return
        number, schema = struct.unpack_from("<HH", data)
        name, at = _string(data, 4)
        encoding, _ = _string(data, at)
        kind = self._schemas.get(schema, "").replace("/msg/", "/")
        if encoding in ENCODINGS and schema in self._schemas:
            self.topics.setdefault(name, Topic(name, kind, encoding))
            self._numbers.setdefault(name, set()).add(number)

    def _find_topics_in_chunks(self, file: BinaryIO) -> None:
        """Find the channels inside the chunks; without the summary they are only there."""
        for part in self._parts:
            try:
                data = _unpacked(file, part)
                for operation, start, stop in _records(data):
                    if operation in (SCHEMA, CHANNEL):
                        self._definition(operation, data[start:stop])
            except (DamagedChunkError, _DamagedError, struct.error, UnicodeDecodeError):
                continue


def _chunk(file: BinaryIO, start: int, size: int) -> _Part:
    head = file.read(min(size, 64))
    _, _, unpacked, crc, length = _CHUNK.unpack_from(head)
    at = _CHUNK.size + length
    compression = head[_CHUNK.size : at].decode()
    stored = struct.unpack_from("<Q", head, at)[0]
    begin = start + at + 8
    return _Part(begin, min(stored, start + size - begin), unpacked, compression, crc)


def _unpacked(file: BinaryIO, part: _Part) -> bytes:
    """Return the records of a part; the checksum of a part that was cut short is not checked."""
    file.seek(part.at)
    data = unpack(part.compression, file.read(part.stored), part.size)
    if part.crc and len(data) >= part.size and crc32(data) != part.crc:
        raise DamagedChunkError("checksum")
    return data


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the operation, and start and stop of the content, of each record."""
    at, end = 0, len(data)
    while at < end:
        if at + 9 > end:
            raise _DamagedError
        operation, size = _OP.unpack_from(data, at)
        at += 9
        if at + size > end:
            raise _DamagedError
        yield operation, at, at + size
        at += size


def _string(data: bytes, at: int) -> tuple[str, int]:
    """Return a string and the position after it."""
    length = struct.unpack_from("<I", data, at)[0]
    if at + 4 + length > len(data):
        raise _DamagedError
    return data[at + 4 : at + 4 + length].decode(), at + 4 + length
