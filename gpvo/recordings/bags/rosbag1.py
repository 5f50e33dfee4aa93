"""Read ROS 1 bags (format 2.0), even if a killed recorder left them without an index.

A record is a header of name=value fields, then data; the length of each comes before it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from gpvo.recordings.bags.chunked_log import Chunk, ChunkedLog, DamagedRecordError
from gpvo.recordings.bags.message_log import Topic

LARGEST_HEADER = 1 << 20
"""Bytes of a record's header; a larger size is a sign of damage."""

MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7

_U4 = struct.Struct("<I")


class RosBag1(ChunkedLog):
    """A ROS 1 bag."""

    name = "ROS 1 bag"
    magic = b"#ROSBAG V2.0\n"

    def __init__(self, path: Path) -> None:
        self._known_headers: dict[bytes, int] = {}
        super().__init__(path)

    def _record(self, file: BinaryIO, at: int, end: int) -> int:
        header, data_at, size = read_header(file, at, end)
        operation = operation_of(header)
        if operation == CHUNK:
            self._chunks.append(_chunk(header, data_at, min(size, end - data_at)))
        if data_at + size > end:
            raise DamagedRecordError
        if operation == INDEX and self._chunks:
            latest = self._chunks[-1]
            latest.numbers = (latest.numbers or set()) | {u4(header, b"conn")}
        elif operation == CONNECTION:
            file.seek(data_at)
            self._connection(header, file.read(size))
        elif operation not in (CHUNK, INDEX, BAG, CHUNK_INFO, MESSAGE):
            raise DamagedRecordError
        return data_at + size

    def _connection(self, header: dict[bytes, bytes], data: bytes) -> None:
        number, fields = u4(header, b"conn"), parse_fields(data)
        try:
            name, kind = header[b"topic"].decode(), fields[b"type"].decode()
        except KeyError as error:
            raise DamagedRecordError from error
        digest = fields.get(b"md5sum", b"").decode()
        self._add_topic(Topic(name, kind.replace("/msg/", "/"), "ros1", digest), number)

    def _find_topics(self, data: bytes) -> None:
        for packed, start, stop in records(data):
            header = parse_fields(packed)
            if operation_of(header) == CONNECTION:
                self._connection(header, data[start:stop])

    def _messages_in(self, data: bytes, wanted: set[int]) -> Iterator[memoryview]:
        view = memoryview(data)
        for header, start, stop in records(data):
            if self._connection_of(header) in wanted:
                yield view[start:stop]

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


def _chunk(header: dict[bytes, bytes], at: int, stored: int) -> Chunk:
    compression = header.get(b"compression", b"").decode(errors="replace")
    return Chunk(at, stored, u4(header, b"size"), compression)


def read_header(file: BinaryIO, at: int, end: int) -> tuple[dict[bytes, bytes], int, int]:
    """Return the header of the record at a position, and the position and size of its data."""
    file.seek(at)
    length = _u4_of(file.read(4))
    if length > min(LARGEST_HEADER, end - at):
        raise DamagedRecordError
    header = parse_fields(file.read(length))
    return header, at + 8 + length, _u4_of(file.read(4))


def records(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Yield the header, and start and stop of the data, of each record in a chunk."""
    at, end = 0, len(data)
    while at < end:
        if at + 8 > end:
            raise DamagedRecordError
        length = _U4.unpack_from(data, at)[0]
        start = at + 8 + length
        if start > end:
            raise DamagedRecordError
        header = data[at + 4 : start - 4]
        stop = start + int(_U4.unpack_from(data, start - 4)[0])
        if stop > end:
            raise DamagedRecordError
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
            raise DamagedRecordError
        fields[name] = value
    return fields


def operation_of(header: dict[bytes, bytes]) -> int:
    """Return the operation code of a header, the kind of its record."""
    value = header.get(b"op", b"")
    if len(value) != 1:
        raise DamagedRecordError
    return value[0]


def u4(header: dict[bytes, bytes], name: bytes) -> int:
    """Return a number of the header."""
    return _u4_of(header.get(name, b""))


def _u4_of(value: bytes) -> int:
    if len(value) != 4:
        raise DamagedRecordError
    return int(_U4.unpack(value)[0])
