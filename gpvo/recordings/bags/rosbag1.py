"""Read ROS 1 bags (format 2.0), even if a killed recorder left them without an index.

The chunks are found by walking through the file, as a bag that is cut short has no reliable index.
The walk reads only a few bytes of each chunk. A record is a header of name=value fields, then data;
the length of each comes before it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from gpvo.errors import InputError
from gpvo.recordings.bags.message_log import MessageLog, Topic
from gpvo.recordings.compression import DamagedChunkError, UnpackedChunks, unpack
from gpvo.recordings.streams import DAMAGED, Faults

LARGEST_HEADER = 1 << 20
"""Bytes of a record's header; a larger size is a sign of damage."""

_U4 = struct.Struct("<I")

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7


def is_rosbag1(path: Path) -> bool:
    """Return whether a file begins with the magic bytes of a ROS 1 bag."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


@dataclass
class _Chunk:
    """Position of a chunk's data, and the connections that its index names (None: unknown)."""

    at: int
    stored: int
    size: int
    compression: str
    connections: set[int] | None = None


@dataclass
class RosBag1(MessageLog):
    """A ROS 1 bag.

    Raises
    ------
    InputError
        If it holds no topic that can be read.
    """

    name = "ROS 1 bag"

    path: Path
    topics: dict[str, Topic] = field(init=False, default_factory=dict)
    notes: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self._chunks: list[_Chunk] = []
        self._numbers: dict[str, set[int]] = {}
        self._unpacked_chunks = UnpackedChunks()
        self._known_headers: dict[bytes, int] = {}
        with self.path.open("rb") as file:
            self._walk(file)
            if not self.topics:
                self._find_topics_in_chunks(file)
        if not self.topics:
            raise InputError(f"{self.path}: holds no topics; record the bag again")

    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        wanted = self._numbers[topic]
        with self.path.open("rb") as file:
            for chunk in reversed(self._chunks) if backwards else self._chunks:
                if chunk.connections is not None and not chunk.connections & wanted:
                    continue
                found = self._messages_of(file, chunk, wanted, faults)
                yield from reversed(list(found)) if backwards else found

    def _walk(self, file: BinaryIO) -> None:
        """Find all chunks and the connections outside of them."""
        file.seek(0, 2)
        end = file.tell()
        at = len(MAGIC)
        try:
            while at < end:
                at = self._record(file, at, end)
        except DamagedRecordError as error:
            self.notes.append(
                f"{self.path}: {error}, {(end - at) / end:.1%} of the file cannot be read;"
                " copy it again, or go on with what is intact"
            )

    def _record(self, file: BinaryIO, at: int, end: int) -> int:
        """Register the record at a position and return the position of the next one."""
        header, data_at, size = read_header(file, at, end)
        operation = operation_of(header)
        if operation == CHUNK:
            chunk = _chunk(header, data_at, size, end)
            self._chunks.append(chunk)
        if data_at + size > end:
            raise DamagedRecordError("the file is cut short or damaged")
        if operation == INDEX and self._chunks:
            latest = self._chunks[-1]
            latest.connections = (latest.connections or set()) | {u4(header, b"conn")}
        elif operation == CONNECTION:
            file.seek(data_at)
            self._connection(header, file.read(size))
        elif operation not in (CHUNK, INDEX, BAG, CHUNK_INFO, MESSAGE):
            raise DamagedRecordError("the file is damaged")
        return data_at + size

    def _connection(self, header: dict[bytes, bytes], data: bytes) -> None:
        number, fields = u4(header, b"conn"), parse_fields(data)
        try:
            name, kind = header[b"topic"].decode(), fields[b"type"].decode()
            digest = fields.get(b"md5sum", b"").decode()
        except (KeyError, UnicodeDecodeError) as error:
            raise DamagedRecordError("the file is damaged") from error
        self.topics.setdefault(name, Topic(name, kind.replace("/msg/", "/"), "ros1", digest))
        self._numbers.setdefault(name, set()).add(number)

    def _find_topics_in_chunks(self, file: BinaryIO) -> None:
        """Find the connections inside the chunks; a bag without its end has them only there."""
        for chunk in self._chunks:
            chunk.connections = None
            try:
                data = _unpacked(file, chunk)
                for packed, start, stop in records(data):
                    header = parse_fields(packed)
                    if operation_of(header) == CONNECTION:
                        self._connection(header, data[start:stop])
            except (DamagedChunkError, DamagedRecordError):
                continue

    def _chunk_data(self, file: BinaryIO, chunk: _Chunk) -> bytes:
        if chunk.compression == "none":
            return _unpacked(file, chunk)
        return self._unpacked_chunks.get(chunk.at, lambda: _unpacked(file, chunk))

    def _connection_of(self, header: bytes) -> int:
        """Return the connection of a message, or -1 for other records.

        Headers of one connection differ only in their times, so each kind is parsed once.
        """
        at = header.find(b"time=")
        kind = header[: at + 5] + header[at + 13 :]
        number = self._known_headers.get(kind)
        if number is None:
            fields = parse_fields(header)
            number = u4(fields, b"conn") if operation_of(fields) == MESSAGE else -1
            self._known_headers[kind] = number
        return number

    def _messages_of(
        self, file: BinaryIO, chunk: _Chunk, wanted: set[int], faults: Faults
    ) -> Iterator[memoryview]:
        try:
            data = self._chunk_data(file, chunk)
            view = memoryview(data)
            for header, start, stop in records(data):
                if self._connection_of(header) in wanted:
                    yield view[start:stop]
        except (DamagedChunkError, DamagedRecordError):
            faults[DAMAGED] += 1


def _chunk(header: dict[bytes, bytes], at: int, size: int, end: int) -> _Chunk:
    compression = header.get(b"compression", b"").decode(errors="replace")
    return _Chunk(at, min(size, end - at), u4(header, b"size"), compression)


def _unpacked(file: BinaryIO, chunk: _Chunk) -> bytes:
    file.seek(chunk.at)
    return unpack(chunk.compression, file.read(chunk.stored), chunk.size)


class DamagedRecordError(Exception):
    """A record that is invalid or ends after the end of the file."""


def read_header(file: BinaryIO, at: int, end: int) -> tuple[dict[bytes, bytes], int, int]:
    """Return the header of the record at a position, and the position and size of its data."""
    file.seek(at)
    length = _u4_of(file.read(4))
    if length > min(LARGEST_HEADER, end - at):
        raise DamagedRecordError("the file is cut short or damaged")
    header = parse_fields(file.read(length))
    return header, at + 8 + length, _u4_of(file.read(4))


def records(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Yield the header, and start and stop of the data, of each record in a chunk."""
    at, end = 0, len(data)
    while at < end:
        if at + 8 > end:
            raise DamagedRecordError("a chunk ends early")
        length = _U4.unpack_from(data, at)[0]
        start = at + 8 + length
        if start > end:
            raise DamagedRecordError("a chunk ends early")
        header = data[at + 4 : start - 4]
        stop = start + int(_U4.unpack_from(data, start - 4)[0])
        if stop > end:
            raise DamagedRecordError("a chunk ends early")
        yield header, start, stop
        at = stop


def parse_fields(data: bytes) -> dict[bytes, bytes]:
    """Parse name=value fields, each of which follows its length."""
    fields: dict[bytes, bytes] = {}
    at, end = 0, len(data)
    while at < end:
        length = _u4_of(data[at : at + 4])
        name, equals, value = data[at + 4 : at + 4 + length].partition(b"=")
        at += 4 + length
        if not equals or at > end:
            raise DamagedRecordError("the file is damaged")
        fields[name] = value
    return fields


def operation_of(header: dict[bytes, bytes]) -> int:
    """Return the operation code of a header, the kind of its record."""
    value = header.get(b"op", b"")
    if len(value) != 1:
        raise DamagedRecordError("the file is damaged")
    return value[0]


def u4(header: dict[bytes, bytes], name: bytes) -> int:
    """Return a number of the header."""
    return _u4_of(header.get(name, b""))


def _u4_of(value: bytes) -> int:
    if len(value) != 4:
        raise DamagedRecordError("the file is cut short or damaged")
    return int(_U4.unpack(value)[0])
