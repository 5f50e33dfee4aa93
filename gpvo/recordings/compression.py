"""Decompress chunks of files, never to more bytes than the file states."""

from __future__ import annotations

import bz2
from collections.abc import Callable

import lz4.frame
import zstandard

LARGEST_CHUNK = 1 << 30
"""Bytes; a larger size is a sign of damage."""

CACHE_BYTES = 1 << 26


class DamagedChunkError(Exception):
    """A chunk that cannot be unpacked."""


def unpack(compression: str, data: bytes, size: int) -> bytes:
    """Decompress a chunk that has `size` bytes according to its file.

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
            # Some frames do not state their size; never read more than the chunk's size.
            return zstandard.ZstdDecompressor().stream_reader(data).read(size)
    except (RuntimeError, OSError, ValueError, EOFError, MemoryError, zstandard.ZstdError) as error:
        raise DamagedChunkError(str(error)) from error
    raise DamagedChunkError(f"packed with {compression!r}")


def _unpack_lz4(data: bytes, size: int) -> bytes:
    """Decompress at once if the frame states its size correctly, else as far as possible."""
    if 0 < lz4.frame.get_frame_info(data)["content_size"] <= size:
        try:
            return lz4.frame.decompress(data)
        except RuntimeError:
            pass
    return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)


class UnpackedChunks:
    """Cache of the chunks unpacked last, as both cameras' events are in the same chunks."""

    def __init__(self) -> None:
        self._chunks: dict[int, bytes] = {}
        self._size = 0

    def get(self, at: int, unpack_chunk: Callable[[], bytes]) -> bytes:
        """Return the chunk at a position of the file, from the cache or unpacked now."""
        if at not in self._chunks:
            data = unpack_chunk()
            self._chunks[at] = data
            self._size += len(data)
            while self._size > CACHE_BYTES and len(self._chunks) > 1:
                self._size -= len(self._chunks.pop(next(iter(self._chunks))))
        return self._chunks[at]
