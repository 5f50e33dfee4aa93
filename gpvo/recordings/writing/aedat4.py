"""Write AEDAT4 with one event stream for each camera."""

from __future__ import annotations

import struct
from pathlib import Path

import lz4.frame
import numpy as np

from gpvo.recordings.base import SIDES
from gpvo.recordings.files.aedat4 import EVENT, MAGIC
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.writer import RecordingWriter, Sizes, microseconds

LZ4 = 1
PACKET_EVENTS = 1 << 15

STREAM = """<node name="{number}" path="/mainloop/Recorder/outInfo/{number}/">
<attr key="compression" type="string">LZ4</attr>
<attr key="originalModuleName" type="string">{name}</attr>
<attr key="originalOutputName" type="string">events</attr>
<attr key="typeDescription" type="string">Array of events (polarity ON/OFF).</attr>
<attr key="typeIdentifier" type="string">EVTS</attr>
<node name="info" path="/mainloop/Recorder/outInfo/{number}/info/">
<attr key="sizeX" type="int">{width}</attr>
<attr key="sizeY" type="int">{height}</attr>
<attr key="source" type="string">{name}</attr>
<attr key="tsOffset" type="long">0</attr>
</node>
</node>
"""
HEADER = """<dv version="2.0">
<node name="outInfo" path="/mainloop/Recorder/outInfo/">
{streams}</node>
</dv>
"""


class Aedat4Writer(RecordingWriter):
    """Writer of streams `left` and `right`, packed by LZ4, without the final table of packets."""

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        cameras = zip(SIDES, sizes, strict=False)
        streams = "".join(
            STREAM.format(number=number, name=side, width=width, height=height)
            for number, (side, (width, height)) in enumerate(cameras)
        )
        self._file = path.open("wb")
        self._file.write(MAGIC + io_header(HEADER.format(streams=streams), LZ4))

    def append(self, *blocks: EventBlock) -> None:
        for number, block in enumerate(blocks):
            for first in range(0, len(block), PACKET_EVENTS):
                packed = lz4.frame.compress(event_packet(block[first : first + PACKET_EVENTS]))
                self._file.write(struct.pack("<ii", number, len(packed)) + packed)

    def close(self) -> None:
        self._file.close()


def io_header(description: str, compression: int) -> bytes:
    """Return a size-prefixed FlatBuffer IOHeader: compression, table position, description."""
    text = description.encode()
    # From the root offset on: identifier, vtable (4 entries), table, string.
    vtable = struct.pack("<HHHHHxx", 10, 24, 4, 8, 16)
    table_at = 8 + len(vtable)
    table = struct.pack("<iiqi", len(vtable), compression, -1, 8) + struct.pack("<i", 0)
    string = struct.pack("<I", len(text)) + text + b"\0"
    body = struct.pack("<I4s", table_at, b"IOHE") + vtable + table + string
    return struct.pack("<I", len(body)) + body


def event_packet(block: EventBlock) -> bytes:
    """Return a size-prefixed FlatBuffer EventPacket: a vector of events of 16 bytes."""
    events = np.zeros(len(block), EVENT)
    events["t"] = microseconds(block.t_ns)
    events["x"], events["y"], events["polarity"] = block.x, block.y, block.polarity
    # Events are aligned to eight bytes, counted from the four bytes of the size on.
    vtable = struct.pack("<HHHxx", 6, 8, 4)
    table = struct.pack("<iI", len(vtable), 4)
    vector = struct.pack("<I", len(block)) + events.tobytes()
    body = struct.pack("<I4s", 8 + len(vtable), b"EVTS") + vtable + table + vector
    return struct.pack("<I", len(body)) + body
