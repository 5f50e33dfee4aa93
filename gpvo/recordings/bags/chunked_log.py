"""Logs made of chunks of records: what ROS 1 bags and MCAP have in common.

The chunks are found by walking through the file, as the index at its end is missing if the
recorder was killed or the copy was cut short. The walk reads only a few bytes of each chunk. The
libraries of both formats, which write them here, stop at the first damage.
"""

from __future__ import annotations

import struct
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar
from zlib import crc32

from gpvo.errors import InputError
from gpvo.recordings.bags.message_log import MessageLog, Topic
from gpvo.recordings.compression import DamagedChunkError, UnpackedChunks, unpack
from gpvo.recordings.streams import DAMAGED, Faults, unread_note


class DamagedRecordError(Exception):
    """A record that is invalid or ends after the end of the file."""


Damage = (DamagedChunkError, DamagedRecordError, struct.error, UnicodeDecodeError)
"""Errors of parsing a damaged file."""


@dataclass
class Chunk:
    """Where a chunk's records are in the file, and how they are packed.

    Attributes
    ----------
    at, stored
        Position and number of its bytes, fewer than were written if the file is cut short.
    size
        Bytes once unpacked.
    compression
        Name of the packing; empty or "none" without one.
    crc
        Checksum of the unpacked bytes; 0 if there is none.
    numbers
        Topics that its index names; None if unknown.
    """

    at: int
    stored: int
    size: int
    compression: str
    crc: int = 0
    numbers: set[int] | None = None

    @property
    def packed(self) -> bool:
        """Whether its bytes have to be unpacked."""
        return self.compression not in ("", "none")

    def unpacked(self, file: BinaryIO) -> bytes:
        """Return its records; the checksum of a chunk that was cut short is not checked."""
        file.seek(self.at)
        data = unpack(self.compression, file.read(self.stored), self.size)
        if self.crc and len(data) >= self.size and crc32(data) != self.crc:
            raise DamagedChunkError("checksum")
        return data


class ChunkedLog(MessageLog):
    """A log made of chunks of records.

    Raises
    ------
    InputError
        If it holds no topic that can be read.
    """

    magic: ClassVar[bytes]
    """First bytes of the file."""
    end_mark: ClassVar[bytes] = b""
    """Last bytes of a complete file."""

    def __init__(self, path: Path) -> None:
        self.path, self.topics, self.notes = path, {}, []
        self._chunks: list[Chunk] = []
        self._numbers: dict[str, set[int]] = {}
        self._unpacked_chunks = UnpackedChunks()
        with path.open("rb") as file:
            self._walk(file)
            if not self.topics:
                self._find_topics_in_chunks(file)
        if not self.topics:
            raise InputError(f"{path}: holds no topics; record it again")

    @classmethod
    def recognise(cls, path: Path) -> bool:
        """Return whether a path is a file that begins like this format."""
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(cls.magic)) == cls.magic

    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        wanted = self._numbers[topic]
        with self.path.open("rb") as file:
            for chunk in reversed(self._chunks) if backwards else self._chunks:
                if chunk.numbers is None or chunk.numbers & wanted:
                    found = self._intact_messages(file, chunk, wanted, faults)
                    yield from reversed(list(found)) if backwards else found

    def _intact_messages(
        self, file: BinaryIO, chunk: Chunk, wanted: set[int], faults: Faults
    ) -> Iterator[memoryview]:
        try:
            if chunk.packed:
                data = self._unpacked_chunks.get(chunk.at, lambda: chunk.unpacked(file))
            else:
                data = chunk.unpacked(file)
            yield from self._messages_in(data, wanted)
        except (DamagedChunkError, DamagedRecordError):
            faults[DAMAGED] += 1

    def _walk(self, file: BinaryIO) -> None:
        """Find all chunks, and the topics outside of them."""
        end = file.seek(0, 2)
        at, stop = len(self.magic), end - len(self.end_mark)
        try:
            while at < stop:
                at = self._record(file, at, end)
        except Damage:
            pass  # the note says how much is lost
        file.seek(stop)
        if at != stop or file.read() != self.end_mark:
            self.notes.append(unread_note(self.path, (end - at) / end))

    def _find_topics_in_chunks(self, file: BinaryIO) -> None:
        """Find the topics inside the chunks; a file without its end has them only there."""
        for chunk in self._chunks:
            chunk.numbers = None
            try:
                self._find_topics(chunk.unpacked(file))
            except Damage:
                continue

    def _add_topic(self, topic: Topic, number: int) -> None:
        self.topics.setdefault(topic.name, topic)
        self._numbers.setdefault(topic.name, set()).add(number)

    @abstractmethod
    def _record(self, file: BinaryIO, at: int, end: int) -> int:
        """Register the record at a position and return the position of the next one."""

    @abstractmethod
    def _find_topics(self, data: bytes) -> None:
        """Register the topics in a chunk's records."""

    @abstractmethod
    def _messages_in(self, data: bytes, wanted: set[int]) -> Iterator[memoryview]:
        """Yield the messages of some topics, by number, in a chunk's records."""
