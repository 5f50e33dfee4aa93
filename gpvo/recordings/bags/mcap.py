"""Read MCAP files, alone or in a ROS 2 bag, even if they were never finished."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from gpvo.recordings.bags.chunked_log import Chunk, ChunkedLog, DamagedRecordError
from gpvo.recordings.bags.message_log import Topic

ENCODINGS = ("ros1", "cdr")
LARGEST_RECORD = 1 << 24
"""Bytes of a schema or channel; a larger size is a sign of damage."""

_OP = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_MESSAGE_HEAD = 22


class McapFile(ChunkedLog):
    """An MCAP file with ROS 1 or CDR messages."""

    name = "MCAP"
    magic = end_mark = b"\x89MCAP0\r\n"

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, str] = {0: ""}
        super().__init__(path)

    def _record(self, file: BinaryIO, at: int, end: int) -> int:
        file.seek(at)
        operation, size = _OP.unpack(file.read(_OP.size))
        start = at + _OP.size
        if operation == Opcode.CHUNK:
            self._chunks.append(_chunk(file, start, min(size, end - start)))
        elif operation == Opcode.MESSAGE:
            self._chunks.append(Chunk(at, min(start + size, end) - at, 0, "none"))
        if start + size > end:
            raise DamagedRecordError
        if operation in (Opcode.SCHEMA, Opcode.CHANNEL):
            if size > LARGEST_RECORD:
                raise DamagedRecordError
            self._definition(operation, file.read(size))
        return int(start + size)

    def _definition(self, operation: int, data: bytes) -> None:
        stream = ReadDataStream(BytesIO(data))
        try:
            if operation == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema.name.replace("/msg/", "/")
                return
            channel = Channel.read(stream)
        except McapError as error:
            raise DamagedRecordError from error
        if channel.message_encoding in ENCODINGS and channel.schema_id in self._schemas:
            kind = self._schemas[channel.schema_id]
            self._add_topic(Topic(channel.topic, kind, channel.message_encoding), channel.id)

    def _find_topics(self, data: bytes) -> None:
        for operation, start, stop in _records(data):
            if operation in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._definition(operation, data[start:stop])

    def _messages_in(self, data: bytes, wanted: set[int]) -> Iterator[memoryview]:
        view = memoryview(data)
        for operation, start, stop in _records(data):
            if operation != Opcode.MESSAGE or stop < start + _MESSAGE_HEAD:
                continue
            if int.from_bytes(view[start : start + 2], "little") in wanted:
                yield view[start + _MESSAGE_HEAD : stop]


def _chunk(file: BinaryIO, start: int, size: int) -> Chunk:
    head = file.read(min(size, 64))
    _, _, unpacked, crc, length = _CHUNK.unpack_from(head)
    at = _CHUNK.size + length
    compression = head[_CHUNK.size : at].decode()
    stored = struct.unpack_from("<Q", head, at)[0]
    begin = start + at + 8
    return Chunk(begin, min(stored, start + size - begin), unpacked, compression, crc)


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the operation, and start and stop of the content, of each record."""
    at, end = 0, len(data)
    while at < end:
        if at + _OP.size > end:
            raise DamagedRecordError
        operation, size = _OP.unpack_from(data, at)
        at += _OP.size
        if at + size > end:
            raise DamagedRecordError
        yield operation, at, at + size
        at += size
