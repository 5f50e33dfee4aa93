"""Write bags by other libraries, message by message, as a reference for our parsers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from recording_files import HEIGHT, WIDTH
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gpvo.recordings.streams import EventBlock

EVENT = "uint16 x\nuint16 y\n{time} ts\nbool polarity\n"
ARRAY = "{header} header\nuint32 height\nuint32 width\n{package}/Event[] events\n"
PACKET = (
    "{header} header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n"
    "string encoding\nbool is_bigendian\nuint8[] events\n"
)

Messages = Sequence[tuple[str, str, int, Any]]
"""Topic, type, stamp and message."""


def types(ros1: bool) -> Any:
    """Return a type store with the event messages."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    time = "time" if ros1 else "builtin_interfaces/Time"
    header = "std_msgs/Header"
    for package in ("dvs_msgs", "prophesee_event_msgs", "dv_ros_msgs"):
        store.register(get_types_from_msg(EVENT.format(time=time), f"{package}/msg/Event"))
        text = ARRAY.format(header=header, package=package)
        store.register(get_types_from_msg(text, f"{package}/msg/EventArray"))
    text = PACKET.format(header=header)
    store.register(get_types_from_msg(text, "event_camera_msgs/msg/EventPacket"))
    return store


def header(store: Any, stamp_ns: int, frame: str, ros1: bool) -> Any:
    sec, nanosec = divmod(int(stamp_ns), 10**9)
    stamp = store.types["builtin_interfaces/msg/Time"](sec, nanosec)
    extra = {"seq": 7} if ros1 else {}
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **extra)


def event_arrays(
    store: Any, topic: str, block: EventBlock, ros1: bool, package: str = "dvs_msgs", size: int = 90
) -> list[tuple[str, str, int, Any]]:
    """Return the events in messages of `size`, one Python object each, after an empty message."""
    time = store.types["builtin_interfaces/msg/Time"]
    event = store.types[f"{package}/msg/Event"]
    array = store.types[f"{package}/msg/EventArray"]
    kind = f"{package}/msg/EventArray"
    messages = []
    for first in [None, *range(0, len(block), size)]:
        part = block[:0] if first is None else block[first : first + size]
        events = [
            event(int(x), int(y), time(*divmod(int(t), 10**9)), bool(p))
            for x, y, t, p in zip(part.x, part.y, part.t_ns, part.polarity, strict=True)
        ]
        stamp = int(part.t_ns[-1]) if len(part) else int(block.t_ns[0])
        head = header(store, stamp, "camera", ros1)
        messages.append((topic, kind, stamp, array(head, HEIGHT, WIDTH, events)))
    return messages


def event_packets(
    store: Any,
    topic: str,
    block: EventBlock,
    ros1: bool,
    encoding: str,
    encode: Callable[[EventBlock, int], np.ndarray],
    size: int = 110,
    delay_ns: int = 0,
) -> list[tuple[str, str, int, Any]]:
    """Return the events in packets, each with its own time base."""
    packet = store.types["event_camera_msgs/msg/EventPacket"]
    messages = []
    for number, first in enumerate(range(0, len(block), size)):
        part = block[first : first + size]
        base = int(part.t_ns[0]) // 1000 * 1000
        data = encode(part, base).view(np.uint8)
        head = header(store, base + delay_ns, "camera_frame", ros1)
        message = packet(head, HEIGHT, WIDTH, number, base, encoding, False, data)
        messages.append((topic, "event_camera_msgs/msg/EventPacket", base + delay_ns, message))
    return messages


def write_rosbag1(
    path: Path, messages: Messages, compression: Any = None, chunk: int = 20_000
) -> Path:
    """Write a ROS 1 bag with small chunks."""
    store = types(True)
    writer = Writer1(path)
    writer.chunk_threshold = chunk
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in {message[:2]: None for message in messages}
        }
        for topic, kind, stamp, message in sorted(messages, key=lambda entry: entry[2]):
            writer.write(connections[topic], stamp, store.serialize_ros1(message, kind))
    return path


def write_rosbag2(folder: Path, messages: Messages, storage: StoragePlugin) -> Path:
    """Write a ROS 2 bag."""
    store = types(False)
    with Writer2(folder, version=9, storage_plugin=storage) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in {message[:2]: None for message in messages}
        }
        for topic, kind, stamp, message in sorted(messages, key=lambda entry: entry[2]):
            writer.write(connections[topic], stamp, store.serialize_cdr(message, kind))
    return folder
