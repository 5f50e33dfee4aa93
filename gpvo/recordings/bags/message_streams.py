"""Event streams of one topic of a log: EventArray or EventPacket messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import TypeVar

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.bags.event_messages import (
    CDR_EVENT,
    ROS1_EVENT,
    DamagedMessageError,
    EventPacket,
    event_array,
    event_block,
    event_packet,
)
from gpvo.recordings.bags.message_log import MessageLog
from gpvo.recordings.decoders import libcaer
from gpvo.recordings.decoders.evt3 import WRAP_US, Evt3
from gpvo.recordings.streams import EventBlock, EventStream, Faults, groups

BLOCK_EVENTS = 1 << 17
"""Number of events; messages are joined to blocks of about this size."""

LAST_EVENTS = 1000
"""Number of events at the end that are read to find when a recording ends."""

LAST_BYTES = 1 << 17
"""Bytes of packets at the end that are read for this; EVT3 repeats the time much sooner."""

DAMAGED_MESSAGE = "damaged messages were skipped"
ENCODINGS = ("evt3", "libcaer_cmp", "libcaer", "mono")
UNKNOWN_ENCODING = "event packets in an unknown encoding were skipped"

M = TypeVar("M")


class TopicStream(EventStream):
    """Event stream of the messages of a topic."""

    def __init__(self, log: MessageLog, name: str) -> None:
        self.where = f"{log.path}: {name}"
        self._log, self._topic = log, log.topics[name]

    def _parsed(
        self, parse: Callable[[memoryview, str], M], faults: Faults, backwards: bool = False
    ) -> Iterator[M]:
        """Yield what a function makes of each message and the encoding; skip damaged ones."""
        for message in self._log.messages(self._topic.name, faults, backwards):
            try:
                yield parse(message, self._topic.encoding)
            except DamagedMessageError:
                faults[DAMAGED_MESSAGE] += 1


class ArrayStream(TopicStream):
    """Event stream of a topic of EventArray messages."""

    def __init__(self, log: MessageLog, name: str) -> None:
        super().__init__(log, name)
        self._dtype = ROS1_EVENT if self._topic.encoding == "ros1" else CDR_EVENT
        first = next(self._parsed(event_array, Faults()), None)
        self.resolution = (first.width, first.height) if first and all(first[:2]) else None

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        for records in groups(self._records(faults), BLOCK_EVENTS * self._dtype.itemsize):
            yield event_block(b"".join(records), self._dtype)

    def ends(self) -> Iterator[EventBlock]:
        """Yield the events of the last messages, enough to separate credible and damaged stamps."""
        backwards = self._records(Faults(), backwards=True)
        for records in islice(groups(backwards, LAST_EVENTS * self._dtype.itemsize), 1):
            yield event_block(b"".join(reversed(records)), self._dtype)

    def _records(self, faults: Faults, backwards: bool = False) -> Iterator[bytes | memoryview]:
        return (array.records for array in self._parsed(event_array, faults, backwards))


class PacketStream(TopicStream):
    """Event stream of a topic of EventPacket messages: evt3, libcaer, libcaer_cmp or mono."""

    def __init__(self, log: MessageLog, name: str) -> None:
        super().__init__(log, name)
        first = self._first_packet()
        self.resolution = (first.width, first.height) if first.width and first.height else None
        self.wrap_ns = WRAP_US * 1000 if first.encoding == "evt3" else 0

    def _first_packet(self) -> EventPacket:
        """Return the first packet in an encoding that is read."""
        others: list[str] = []
        for packet in self._packets(Faults()):
            if packet.encoding in ENCODINGS:
                return packet
            others.append(repr(packet.encoding))
        if not others:
            raise InputError(f"{self.where}: holds no events; both cameras are needed")
        names = ", ".join(dict.fromkeys(others))
        raise InputError(
            f"{self.where}: its packets have the encoding {names}; gpvo reads"
            f" {', '.join(ENCODINGS)}: set the driver to one of them, or convert the bag"
        )

    def arrival_offset_ns(self) -> int | None:
        """Return the stamp of the first message with events minus its first event's sensor time."""
        if not self.wrap_ns:
            return None
        decoder = Evt3()
        for packet in self._packets(Faults()):
            for block in _decode(packet, decoder) if packet.encoding == "evt3" else ():
                return packet.stamp_ns - int(block.t_ns[0])
        return None

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        decoded = self._decoded(self._packets(faults), None, faults)
        yield from map(EventBlock.concatenate, groups(decoded, BLOCK_EVENTS))

    def ends(self) -> Iterator[EventBlock]:
        """Yield the events of the last packets, except those of EVT3 before its first time."""
        packets: list[EventPacket] = []
        size = 0
        for packet in self._packets(Faults(), backwards=True):
            packets.append(packet)
            size += len(packet.data)
            if size >= LAST_BYTES:
                break
        offset_ns = self.arrival_offset_ns()
        yield from self._decoded(reversed(packets), offset_ns, Faults())

    def _packets(self, faults: Faults, backwards: bool = False) -> Iterator[EventPacket]:
        return self._parsed(event_packet, faults, backwards)

    def _decoded(
        self, packets: Iterable[EventPacket], offset_ns: int | None, faults: Faults
    ) -> Iterator[EventBlock]:
        """Yield each packet's events; `offset_ns` is arrival minus sensor time at the start."""
        sensor, packed = Evt3(), libcaer.LibcaerPacked()
        for packet in packets:
            decoder = sensor if packet.encoding == "evt3" else packed
            try:
                blocks = list(_decode(packet, decoder))
            except DamagedMessageError:
                faults[UNKNOWN_ENCODING] += 1
                continue
            for block in blocks:
                if packet.encoding == "evt3":
                    arrival_ns = packet.stamp_ns - int(block.t_ns[0])
                    offset_ns = arrival_ns if offset_ns is None else offset_ns
                    block = self._unwrapped(block, arrival_ns - offset_ns)
                yield block

    def _unwrapped(self, block: EventBlock, late_ns: int) -> EventBlock:
        """Add the wraps of the sensor's clock that were lost with packets, by the arrival time."""
        wraps = round(late_ns / self.wrap_ns) if self.wrap_ns else 0
        if wraps == 0:
            return block
        return EventBlock(block.x, block.y, block.t_ns + wraps * self.wrap_ns, block.polarity)


def _decode(packet: EventPacket, decoder: Evt3 | libcaer.LibcaerPacked) -> Iterator[EventBlock]:
    """Yield the events of a packet; raise DamagedMessageError if its encoding is unknown."""
    data = np.frombuffer(packet.data, np.uint8)
    # A packet cut short ends with the last whole word.
    if packet.encoding == "evt3" and isinstance(decoder, Evt3):
        yield from decoder.decode(data[: len(data) // 2 * 2].view("<u2"))
    elif packet.encoding == "libcaer_cmp" and isinstance(decoder, libcaer.LibcaerPacked):
        yield from decoder.decode(data[: len(data) // 2 * 2].view("<u2"), packet.time_base_ns)
    elif packet.encoding in ("libcaer", "mono"):
        decode = libcaer.records if packet.encoding == "libcaer" else libcaer.mono
        block = decode(data[: len(data) // 8 * 8], packet.time_base_ns)
        if len(block):
            yield block
    else:
        raise DamagedMessageError
