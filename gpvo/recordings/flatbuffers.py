"""The few parts of FlatBuffers that AEDAT4 needs: fields of a table, strings, vectors."""

from __future__ import annotations

import struct


class Table:
    """A table in a buffer; positions are checked, as buffers may be damaged.

    Raises
    ------
    struct.error
        Where a position lies outside of the buffer.
    """

    def __init__(self, buffer: bytes, position: int) -> None:
        self.buffer, self.position = buffer, position
        self._vtable = position - int(_unpack("<i", buffer, position))
        self._size = int(_unpack("<H", buffer, self._vtable))

    @staticmethod
    def root(buffer: bytes) -> Table:
        """The root table of a size-prefixed buffer."""
        return Table(buffer, 4 + int(_unpack("<I", buffer, 4)))

    def scalar(self, number: int, code: str, default: int) -> int:
        """A number, given its struct code."""
        at = self._field(number)
        return default if at is None else int(_unpack("<" + code, self.buffer, at))

    def vector(self, number: int, item_size: int) -> memoryview:
        """Bytes of a vector or string; empty if it is left out."""
        at = self._field(number)
        if at is None:
            return memoryview(b"")
        at += int(_unpack("<I", self.buffer, at))
        size = item_size * int(_unpack("<I", self.buffer, at))
        if at + 4 + size > len(self.buffer):
            raise struct.error("a vector ends behind its buffer")
        return memoryview(self.buffer)[at + 4 : at + 4 + size]

    def _field(self, number: int) -> int | None:
        place = 4 + 2 * number
        if place + 2 > self._size:
            return None
        offset = int(_unpack("<H", self.buffer, self._vtable + place))
        return self.position + offset if offset else None


def _unpack(code: str, buffer: bytes, at: int) -> int:
    if at < 0:
        raise struct.error("a position before the buffer")
    return int(struct.unpack_from(code, buffer, at)[0])
