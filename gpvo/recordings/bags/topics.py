"""Stereo recordings in logs of messages: ROS 1 bags, ROS 2 bags, MCAP."""

from __future__ import annotations

from gpvo.errors import InputError
from gpvo.recordings.bags.camera_info_messages import camera_info_of_log
from gpvo.recordings.bags.message_log import MessageLog, Topic
from gpvo.recordings.bags.message_streams import ArrayStream, PacketStream
from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.find import Calibration, rig_for
from gpvo.recordings.pairing import choose_pair
from gpvo.recordings.stereo import StreamRecording
from gpvo.recordings.streams import EventStream

EVENT_ARRAY_MD5 = "5e8beee5a6c107e504c2e78903c224b8"
EVENT_PACKET_MD5 = "8a6101b351a64529ac77bd8b71074e52"
PACKET_TYPES = ("event_camera_msgs/EventPacket", "event_array_msgs/EventArray")


def is_array(topic: Topic) -> bool:
    """Return whether a topic has EventArray messages, by its md5 or, without one, by its type."""
    if topic.digest:
        return topic.digest == EVENT_ARRAY_MD5
    return topic.type.endswith("/EventArray") and topic.type not in PACKET_TYPES


def is_packet(topic: Topic) -> bool:
    """Return whether a topic has EventPacket messages, by its md5 or, without one, by its type."""
    if topic.digest:
        return topic.digest == EVENT_PACKET_MD5
    return topic.type in PACKET_TYPES


def event_topics(log: MessageLog) -> list[str]:
    """Return the names of the topics with events."""
    return sorted(name for name, topic in log.topics.items() if is_array(topic) or is_packet(topic))


def topic_stream(log: MessageLog, name: str) -> EventStream:
    """Return the event stream of one topic."""
    if is_array(log.topics[name]):
        return ArrayStream(log, name)
    return PacketStream(log, name)


def open_log(
    log: MessageLog, calibration: Calibration, left: str | None, right: str | None
) -> Recording:
    """Open the two event topics of a log.

    Without a calibration, the camera_info topics beside the events are used.

    Raises
    ------
    InputError
        If it has fewer than two event topics, or their names do not identify the cameras; the
        message lists flags to choose from.
    """
    names = event_topics(log)
    if not names:
        listing = ", ".join(f"{topic.name} ({topic.type})" for topic in log.topics.values())
        raise InputError(f"{log.path}: has no topic with events, only {listing}")
    first, second = choose_pair(log.path, names, left, right, "topic")
    rig = camera_info_of_log(log, first, second) if calibration is None and second else None
    rig = rig or rig_for(log.path, calibration, "the bag")
    streams = [topic_stream(log, name) for name in (first, second) if name]
    streams[0].notes = log.notes
    return StreamRecording(log.path, log.name, rig, *streams)
