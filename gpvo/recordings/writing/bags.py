"""Write ROS 1 bags and MCAP with dvs_msgs/EventArray."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.writer import Writer as McapLibraryWriter
from rosbags.rosbag1 import Writer as Rosbag1LibraryWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gpvo.recordings.bags.event_messages import CDR_EVENT, ROS1_EVENT
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.writer import RecordingWriter, Sizes

PACKET_NS = 1_000_000
"""One message per millisecond, as trackers that run in ROS expect."""

TOPICS = ("/davis/left/events", "/davis/right/events")
TYPE = "dvs_msgs/msg/EventArray"
EVENT = "uint16 x\nuint16 y\n{time} ts\nbool polarity\n"
EVENT_ARRAY = "{header} header\nuint32 height\nuint32 width\n{event}[] events\n"
ROS2_SCHEMA = """std_msgs/Header header
uint32 height
uint32 width
dvs_msgs/Event[] events
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: dvs_msgs/Event
uint16 x
uint16 y
builtin_interfaces/Time ts
bool polarity
"""


class RosBag1Writer(RecordingWriter):
    """Writer of a ROS 1 bag with /davis/left/events and /davis/right/events."""

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        self._sizes = sizes
        self._writer = Rosbag1LibraryWriter(path)
        self._writer.open()
        types = get_typestore(Stores.ROS1_NOETIC)
        types.register(get_types_from_msg(EVENT.format(time="time"), "dvs_msgs/msg/Event"))
        array = EVENT_ARRAY.format(header="std_msgs/Header", event="dvs_msgs/Event")
        types.register(get_types_from_msg(array, TYPE))
        self._connections = [
            self._writer.add_connection(topic, TYPE, typestore=types)
            for topic in TOPICS[: len(sizes)]
        ]

    def append(self, *blocks: EventBlock) -> None:
        for side, packet in packets(*blocks):
            stamp_ns = int(packet.t_ns[-1])
            message = ros1_event_array(packet, self._sizes[side])
            self._writer.write(self._connections[side], stamp_ns, message)

    def close(self) -> None:
        self._writer.close()


class McapWriter(RecordingWriter):
    """Writer of MCAP with ROS 2 messages on /davis/left/events and /davis/right/events."""

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        self._sizes = sizes
        self._file = path.open("wb")
        self._writer = McapLibraryWriter(self._file)
        self._writer.start(profile="ros2", library="gpvo")
        schema = self._writer.register_schema(TYPE, "ros2msg", ROS2_SCHEMA.encode())
        self._channels = [
            self._writer.register_channel(topic, "cdr", schema) for topic in TOPICS[: len(sizes)]
        ]

    def append(self, *blocks: EventBlock) -> None:
        for side, packet in packets(*blocks):
            stamp_ns = int(packet.t_ns[-1])
            message = cdr_event_array(packet, self._sizes[side])
            self._writer.add_message(self._channels[side], stamp_ns, message, stamp_ns)

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()


def packets(*blocks: EventBlock) -> Iterator[tuple[int, EventBlock]]:
    """Yield pieces of one millisecond of all cameras (0 left, 1 right), in time order."""
    pieces = [
        (int(piece.t_ns[-1]), side, piece)
        for side, block in enumerate(blocks)
        for piece in _pieces(block)
    ]
    for _, side, piece in sorted(pieces, key=lambda entry: entry[:2]):
        yield side, piece


def _pieces(block: EventBlock) -> Iterator[EventBlock]:
    """Yield the events of each millisecond that has any."""
    milliseconds = block.t_ns // PACKET_NS
    edges = np.flatnonzero(np.diff(milliseconds)) + 1
    for first, stop in zip([0, *edges], [*edges, len(block)], strict=True):
        if stop > first:
            yield block[first:stop]


def ros1_event_array(block: EventBlock, resolution: tuple[int, int]) -> bytes:
    """Return a serialised ROS 1 message with the stamp of its last event."""
    sec, nsec = divmod(int(block.t_ns[-1]), 10**9)
    width, height = resolution
    head = struct.pack("<IIIIIII", 0, sec, nsec, 0, height, width, len(block))
    return head + _records(block, ROS1_EVENT).tobytes()


def cdr_event_array(block: EventBlock, resolution: tuple[int, int]) -> bytes:
    """Return a serialised ROS 2 message with the stamp of its last event."""
    sec, nsec = divmod(int(block.t_ns[-1]), 10**9)
    width, height = resolution
    head = struct.pack("<IiII4sIII", 0x100, sec, nsec, 1, b"", height, width, len(block))
    records = _records(block, CDR_EVENT).tobytes()
    # The first event has no padding before its time, the others have two bytes.
    return head + records[:4] + records[6:-1]


def _records(block: EventBlock, kind: np.dtype) -> np.ndarray:
    records = np.zeros(len(block), kind)
    records["x"], records["y"], records["polarity"] = block.x, block.y, block.polarity
    records["sec"], records["nsec"] = np.divmod(block.t_ns, 10**9)
    return records
