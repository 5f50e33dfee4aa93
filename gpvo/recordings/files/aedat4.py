"""Read AEDAT4 of iniVation's DV: both cameras in one file, or one file for each."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.find import Calibration, rig_for
from gpvo.recordings.compression import DamagedChunkError, unpack
from gpvo.recordings.pairing import camera_files, choose_pair, files_of
from gpvo.recordings.stereo import StreamRecording
from gpvo.recordings.streams import DAMAGED, EventBlock, EventStream, Faults, groups, unread_note

MAGIC = b"#!AER-DAT4.0\r\n"
COMPRESSIONS = ("none", "lz4", "lz4", "zstd", "zstd")
"""Compressions by their number in the header."""

LARGEST_PACKET = 1 << 27
"""Bytes; unpacked packets may not be larger."""

BLOCK_EVENTS = 1 << 16
LAST_PACKETS = 8
EVENT = np.dtype(
    {
        "names": ["t", "x", "y", "polarity"],
        "formats": ["<i8", "<i2", "<i2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)


def is_aedat4(path: Path) -> bool:
    """Return whether a file begins like AEDAT4, or a folder contains such files."""
    if path.is_dir():
        return bool(_files(path))
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def _files(folder: Path) -> list[Path]:
    return [file for file in files_of(folder, (".aedat4",)) if is_aedat4(file)]


def open_aedat4(
    path: Path, calibration: Calibration, left: str | None, right: str | None
) -> Recording:
    """Open both event streams of a file, or those of a pair of files."""
    file = Aedat4(path) if path.is_file() else None
    if file is not None and len(file.sensors) > 1:
        names = choose_pair(path, list(file.sensors), left, right, "stream")
        streams = [Aedat4Stream(file, name) for name in names if name]
    else:
        folder = path if path.is_dir() else path.parent
        left = path.name if file is not None and left in file.sensors else left
        both = camera_files(path, lambda: _files(folder), left, right)
        streams = [_only_stream(one) for one in both if one]
    return StreamRecording(path, "AEDAT4", rig_for(path, calibration, "AEDAT4"), *streams)


class Sensor(NamedTuple):
    """An event stream: its number in the file, and (width, height)."""

    number: int
    resolution: tuple[int, int] | None


class _Packet(NamedTuple):
    stream: int
    at: int
    size: int


@dataclass
class Aedat4:
    """An AEDAT4 file, whose packets are found by walking through it.

    Attributes
    ----------
    sensors
        Event streams by the name of the camera (made unique by the number of the stream).

    Raises
    ------
    InputError
        If its header cannot be read.
    """

    path: Path
    sensors: dict[str, Sensor] = field(init=False)
    notes: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        with self.path.open("rb") as file:
            file.seek(len(MAGIC))
            try:
                size = struct.unpack("<I", file.read(4))[0]
                if size > LARGEST_PACKET:
                    raise struct.error("header")
                header = FlatTable.root(struct.pack("<I", size) + file.read(size))
                self._compression = COMPRESSIONS[header.scalar(0, "i", 0)]
                table_at = header.scalar(1, "q", -1)
                self.sensors = _sensors(bytes(header.vector(2, 1)).decode())
            except (struct.error, IndexError, ValueError, ElementTree.ParseError) as error:
                raise InputError(
                    f"{self.path}: the header of this AEDAT4 is damaged; copy it again"
                ) from error
        self._packets = self._walk(len(MAGIC) + 4 + size, table_at)

    def packets(self, number: int, faults: Faults, backwards: bool = False) -> Iterator[EventBlock]:
        """Yield the events of each packet of a stream."""
        with self.path.open("rb") as file:
            for packet in reversed(self._packets) if backwards else self._packets:
                if packet.stream == number:
                    file.seek(packet.at)
                    try:
                        yield self._events(file.read(packet.size))
                    except (DamagedChunkError, struct.error):
                        faults[DAMAGED] += 1

    def _walk(self, start: int, table_at: int) -> list[_Packet]:
        end = self.path.stat().st_size
        stop = table_at if start <= table_at <= end else end
        packets, at = [], start
        with self.path.open("rb") as reader:
            while at + 8 <= stop:
                reader.seek(at)
                number, size = struct.unpack("<ii", reader.read(8))
                if number < 0 or not 0 <= size <= stop - at - 8:
                    break
                packets.append(_Packet(number, at + 8, size))
                at += 8 + size
        if at != stop:
            self.notes.append(unread_note(self.path, (end - at) / end))
        elif table_at > end:
            self.notes.append(
                f"{self.path}: the file is cut short, its end is missing; copy it again, or go on"
                " with what is intact"
            )
        return packets

    def _events(self, data: bytes) -> EventBlock:
        packed = self._compression != "none"
        buffer = unpack(self._compression, data, LARGEST_PACKET) if packed else data
        events = np.frombuffer(FlatTable.root(buffer).vector(0, EVENT.itemsize), EVENT)
        # Negative pixels become large ones, outside of every sensor.
        x, y = events["x"].astype(np.uint16), events["y"].astype(np.uint16)
        return EventBlock(x, y, events["t"] * np.int64(1000), events["polarity"] != 0)


class Aedat4Stream(EventStream):
    """One event stream of a file."""

    def __init__(self, file: Aedat4, name: str) -> None:
        self.where = f"{file.path}: {name}"
        self._file, self._sensor = file, file.sensors[name]
        self.resolution, self.notes = self._sensor.resolution, file.notes

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        packets = self._file.packets(self._sensor.number, faults)
        yield from map(EventBlock.concatenate, groups(packets, BLOCK_EVENTS))

    def ends(self) -> Iterator[EventBlock]:
        packets = self._file.packets(self._sensor.number, Faults(), backwards=True)
        yield from reversed(list(islice(packets, LAST_PACKETS)))


def _only_stream(path: Path) -> Aedat4Stream:
    """Return the event stream of a file of one camera."""
    file = Aedat4(path)
    if len(file.sensors) != 1:
        listing = ", ".join(file.sensors) or "none"
        raise InputError(f"{path}: must hold one event stream, it has {listing}")
    return Aedat4Stream(file, next(iter(file.sensors)))


def _sensors(description: str) -> dict[str, Sensor]:
    """Return the event streams in the XML of the header."""
    if "<!" in description:
        raise ValueError("the description declares entities")
    sensors: dict[str, Sensor] = {}
    for stream in ElementTree.fromstring(description).findall(".//node[@name='outInfo']/node"):
        values = {one.get("key"): one.text or "" for one in stream.iter("attr")}
        if values.get("typeIdentifier") != "EVTS":
            continue
        number = int(stream.get("name", ""))
        size = int(values.get("sizeX", 0)), int(values.get("sizeY", 0))
        name = values.get("source") or values.get("originalOutputName") or "events"
        name = f"{name}_{number}" if name in sensors else name
        sensors[name] = Sensor(number, size if all(size) else None)
    return sensors


class FlatTable:
    """A table of FlatBuffers, with only the functions that AEDAT4 needs.

    Positions are checked, as buffers may be damaged.

    Raises
    ------
    struct.error
        If a position lies outside of the buffer.
    """

    def __init__(self, buffer: bytes, position: int) -> None:
        self.buffer, self.position = buffer, position
        self._vtable = position - int(_unpack("<i", buffer, position))
        self._size = int(_unpack("<H", buffer, self._vtable))

    @staticmethod
    def root(buffer: bytes) -> FlatTable:
        """Return the root table of a size-prefixed buffer."""
        return FlatTable(buffer, 4 + int(_unpack("<I", buffer, 4)))

    def scalar(self, number: int, code: str, default: int) -> int:
        """Return a number, given its struct code, or the default if it is left out."""
        at = self._field(number)
        return default if at is None else int(_unpack("<" + code, self.buffer, at))

    def vector(self, number: int, item_size: int) -> memoryview:
        """Return the bytes of a vector or string; empty if it is left out."""
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
