"""Parse serialised event messages of ROS 1 and ROS 2 without a Python object for each event.

Layouts: EventArray of dvs_msgs, prophesee_event_msgs and dv_ros_msgs (the same definition), and
EventPacket of event_camera_msgs. Both encodings are little endian.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from gpvo.recordings.streams import EventBlock

ROS1_EVENT = np.dtype(
    [("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("polarity", "u1")]
)
"""Packed, 13 bytes."""

CDR_EVENT = np.dtype(
    {
        "names": ["x", "y", "sec", "nsec", "polarity"],
        "formats": ["<u2", "<u2", "<i4", "<u4", "u1"],
        "offsets": [0, 2, 6, 10, 14],
        "itemsize": 16,
    }
)
"""An event after the first one in CDR, whose alignment pads two bytes before the time."""

_U4 = struct.Struct("<I")


class DamagedMessageError(Exception):
    """A message whose lengths contradict each other."""


class EventArray(NamedTuple):
    """Sensor and records (ROS1_EVENT or CDR_EVENT) of one message."""

    width: int
    height: int
    records: bytes | memoryview


class EventPacket(NamedTuple):
    """One message of event_camera_msgs."""

    stamp_ns: int
    width: int
    height: int
    time_base_ns: int
    encoding: str
    data: memoryview


def event_array(message: memoryview, encoding: str) -> EventArray:
    """Parse an EventArray message.

    Raises
    ------
    DamagedMessageError
        If the message is shorter than the lengths in it.
    """
    try:
        return _ros1_array(message) if encoding == "ros1" else _cdr_array(message)
    except struct.error as error:
        raise DamagedMessageError from error


def _ros1_array(message: memoryview) -> EventArray:
    at = 16 + _U4.unpack_from(message, 12)[0]
    height, width, count = struct.unpack_from("<III", message, at)
    start, size = at + 12, count * ROS1_EVENT.itemsize
    if start + size > len(message):
        raise DamagedMessageError
    return EventArray(width, height, message[start : start + size])


def _cdr_array(message: memoryview) -> EventArray:
    body = message[4:]
    at = _aligned(12 + _U4.unpack_from(body, 8)[0], 4)
    height, width, count = struct.unpack_from("<III", body, at)
    start, size = at + 12, 16 * count
    if count == 0:
        return EventArray(width, height, b"")
    if start + size - 3 > len(body):
        raise DamagedMessageError
    # The first event has no padding before its time; add the padding that the others have.
    first, rest = body[start : start + 4], body[start + 4 : start + size - 3]
    return EventArray(width, height, b"".join([first, b"\0\0", rest, b"\0"]))


def event_block(records: bytes | memoryview, dtype: np.dtype) -> EventBlock:
    """Return the columns of the joined event records of any number of messages."""
    events = np.frombuffer(records, dtype)
    t_ns = events["sec"] * np.int64(10**9)
    t_ns += events["nsec"]
    return EventBlock(
        np.ascontiguousarray(events["x"]),
        np.ascontiguousarray(events["y"]),
        t_ns,
        events["polarity"] != 0,
    )


def event_packet(message: memoryview, encoding: str) -> EventPacket:
    """Parse an EventPacket message.

    Raises
    ------
    DamagedMessageError
        If the message is shorter than the lengths in it.
    """
    try:
        return _ros1_packet(message) if encoding == "ros1" else _cdr_packet(message)
    except (struct.error, UnicodeDecodeError) as error:
        raise DamagedMessageError from error


def _ros1_packet(message: memoryview) -> EventPacket:
    sec, nsec, length = struct.unpack_from("<III", message, 4)
    at = 16 + length
    height, width, _, time_base, length = struct.unpack_from("<IIQQI", message, at)
    at += 28
    encoding = bytes(message[at : at + length]).decode()
    data = _tail(message, at + length + 1)
    return EventPacket(sec * 10**9 + nsec, width, height, time_base, encoding, data)


def _cdr_packet(message: memoryview) -> EventPacket:
    body = message[4:]
    sec, nsec, length = struct.unpack_from("<iII", body, 0)
    at = _aligned(12 + length, 4)
    height, width = struct.unpack_from("<II", body, at)
    at = _aligned(at + 8, 8)
    _, time_base, length = struct.unpack_from("<QQI", body, at)
    at += 20
    encoding = bytes(body[at : at + length]).rstrip(b"\0").decode()
    data = _tail(body, _aligned(at + length + 1, 4))
    return EventPacket(sec * 10**9 + nsec, width, height, time_base, encoding, data)


def _tail(message: memoryview, at: int) -> memoryview:
    """Return the sequence of bytes that follows its length."""
    size = _U4.unpack_from(message, at)[0]
    if at + 4 + size > len(message):
        raise DamagedMessageError
    return message[at + 4 : at + 4 + size]


def _aligned(at: int, size: int) -> int:
    return -(-at // size) * size
