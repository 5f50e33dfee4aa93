"""What bags have in common: topics, and their raw messages one after the other."""

from __future__ import annotations

import bz2
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar, NamedTuple

import lz4.frame
import zstandard

from gpvo.recordings.streams import Faults

LARGEST_CHUNK = 1 << 30
"""Bytes; a larger chunk is damage."""

CACHE_BYTES = 1 << 26

DAMAGED = "damaged parts of the file were skipped"


class Topic(NamedTuple):
    """One topic of a log.

    `type` is package/Name without the /msg/ of ROS 2; `encoding` is "ros1" or "cdr"; `digest` is
    the md5 of a ROS 1 definition, empty for ROS 2.
    """

    name: str
    type: str
    encoding: str
    digest: str = ""


class MessageLog(ABC):
    """A file of messages on topics.

    Attributes
    ----------
    name
        Of the format, for reports.
    path
        The file or folder.
    topics
        By name.
    notes
        What could not be read when it was opened.
    """

    name: ClassVar[str]
    path: Path
    topics: dict[str, Topic]
    notes: list[str]

    @abstractmethod
    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        """Yield the serialised messages of a topic, in the order of the file or backwards.

        Damage is skipped and counted in `faults`.
        """


class DamagedChunkError(Exception):
    """A chunk that cannot be unpacked."""


def unpack(compression: str, data: bytes, size: int) -> bytes:
    """Decompress a chunk whose file promises `size` bytes.

    Raises
    ------
    DamagedChunkError
        If it cannot be decompressed.
    """
    if compression in ("none", ""):
        return data
    if not 0 <= size <= LARGEST_CHUNK:
        raise DamagedChunkError(f"of {size} bytes")
    try:
        if compression == "lz4":
            return _unpack_lz4(data, size)
        if compression == "bz2":
            return bz2.BZ2Decompressor().decompress(data, max_length=size)
        if compression == "zstd":
            # Frames may leave out their size; never believe more than the chunk's own.
            return zstandard.ZstdDecompressor().stream_reader(data).read(size)
    except (RuntimeError, OSError, ValueError, EOFError, MemoryError, zstandard.ZstdError) as error:
        raise DamagedChunkError(str(error)) from error
    raise DamagedChunkError(f"packed with {compression!r}")


def _unpack_lz4(data: bytes, size: int) -> bytes:
    """In one go where the frame tells its size truthfully; or else as far as it goes."""
    if 0 < lz4.frame.get_frame_info(data)["content_size"] <= size:
        try:
            return lz4.frame.decompress(data)
        except RuntimeError:
            pass
    return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)


class UnpackedChunks:
    """The chunks unpacked last: both cameras' events stand in the same ones."""

    def __init__(self) -> None:
        self._chunks: dict[int, bytes] = {}
        self._size = 0

    def get(self, at: int, unpack_chunk: Callable[[], bytes]) -> bytes:
        """The chunk at a position of the file, unpacked now unless it was a short time ago."""
        if at not in self._chunks:
            data = unpack_chunk()
            self._chunks[at] = data
            self._size += len(data)
            while self._size > CACHE_BYTES and len(self._chunks) > 1:
                self._size -= len(self._chunks.pop(next(iter(self._chunks))))
        return self._chunks[at]
