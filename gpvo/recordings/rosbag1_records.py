"""Records of ROS 1 bags: a header of name=value fields, then data, each after its length."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO

LARGEST_HEADER = 1 << 20
"""Bytes; a longer header is damage."""

_U4 = struct.Struct("<I")


class DamagedRecordError(Exception):
    """A record that makes no sense, or ends behind the end of the file."""


def read_header(file: BinaryIO, at: int, end: int) -> tuple[dict[bytes, bytes], int, int]:
    """Header fields of the record at a position, and position and size of its data."""
    file.seek(at)
    length = _u4_of(file.read(4))
    if length > min(LARGEST_HEADER, end - at):
        raise DamagedRecordError("the file is cut short or damaged")
    header = parse_fields(file.read(length))
    return header, at + 8 + length, _u4_of(file.read(4))


def records(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Header, start and stop of the data of each record in a chunk."""
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
    """name=value fields, each after its length."""
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
    """What kind of record it is."""
    value = header.get(b"op", b"")
    if len(value) != 1:
        raise DamagedRecordError("the file is damaged")
    return value[0]


def u4(header: dict[bytes, bytes], name: bytes) -> int:
    """A number of the header."""
    return _u4_of(header.get(name, b""))


def _u4_of(value: bytes) -> int:
    if len(value) != 4:
        raise DamagedRecordError("the file is cut short or damaged")
    return int(_U4.unpack(value)[0])
