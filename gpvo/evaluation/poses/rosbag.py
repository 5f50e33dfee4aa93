"""Poses from ROS 1 and ROS 2 bags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

POSE_TYPES = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
}
"""Functions that return the pose (position, orientation) of each message type."""


def read_pose_bag(path: Path, topic: str | None = None) -> StampedPoses:
    """Read one pose topic of a bag; stamps are those of the message headers.

    Raises
    ------
    InputError
        If the bag cannot be read, has no pose topic, or has several and none is named.
    """
    try:
        typestore = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=typestore) as reader:
            return _read_topic(reader, path, topic)
    except (AnyReaderError, OSError) as error:
        raise InputError(f"{path}: cannot be read as a ROS bag ({error})") from error


def _read_topic(reader: AnyReader, path: Path, topic: str | None) -> StampedPoses:
    connections = [one for one in reader.connections if one.msgtype in POSE_TYPES]
    topics = sorted({connection.topic for connection in connections})
    if topic is None and len(topics) == 1:
        topic = topics[0]
    if topic not in topics:
        listing = " ".join(f"{path}:{name}" for name in topics) or "none of them holds poses"
        raise InputError(f"{path}: name one pose topic: {listing}")
    chosen = [connection for connection in connections if connection.topic == topic]
    stamps, values = [], []
    for connection, _, raw in reader.messages(connections=chosen):
        message: Any = reader.deserialize(raw, connection.msgtype)
        stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        values.append(_pose_values(POSE_TYPES[connection.msgtype](message)))
    return _stamped_poses(stamps, np.array(values), f"{path}:{topic}")


def _pose_values(pose: Any) -> list[float]:
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _stamped_poses(stamps: list[int], values: np.ndarray, place: str) -> StampedPoses:
    if not stamps:
        raise InputError(f"{place}: holds no message")
    if not np.linalg.norm(values[:, 3:], axis=1).all():
        raise InputError(f"{place}: holds an orientation that is no rotation (all zeros)")
    rotations = Rotation.from_quat(values[:, 3:]).as_matrix()
    transforms = rigid_transforms(rotations, values[:, :3])
    return StampedPoses.read_from(place, np.array(stamps, np.int64), transforms)
