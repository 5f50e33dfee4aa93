"""Write a result as MCAP with ROS 2 messages, which Foxglove and ROS 2's tools show.

/gpvo/odometry (nav_msgs/Odometry, with covariances), /gpvo/pose (geometry_msgs/PoseStamped),
/gpvo/path (nav_msgs/Path), /gpvo/landmarks (sensor_msgs/PointCloud2), /tf (tf2_msgs/TFMessage).
Frames: `world` is the trajectory's, `left_camera` the rectified left camera's, z forward.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from gpvo.errors import InputError
from gpvo.mapping import LandmarkMap
from gpvo.trajectory import Trajectory
from gpvo.trajectory.stamped_poses import quaternions

Array = NDArray[np.float64]

RATE = 100.0
"""Poses per second."""
PATH_RATE = 20.0
"""Poses per second of the whole path, which is written at its end."""
PATH_EVERY = 1.0
"""Seconds between messages of the path so far."""
WORLD, CAMERA = "world", "left_camera"
ROS_ORDER = np.array([3, 4, 5, 0, 1, 2])
"""ROS has translation first."""
TOPICS = {
    "/gpvo/odometry": "nav_msgs/msg/Odometry",
    "/gpvo/pose": "geometry_msgs/msg/PoseStamped",
    "/gpvo/path": "nav_msgs/msg/Path",
    "/gpvo/landmarks": "sensor_msgs/msg/PointCloud2",
    "/tf": "tf2_msgs/msg/TFMessage",
}


def write_result_mcap(path: Path, trajectory: Trajectory, landmarks: LandmarkMap | None) -> int:
    """Write poses, path and landmarks; return the number of messages.

    Raises
    ------
    InputError
        If the file exists or cannot be written.
    """
    if path.exists():
        raise InputError(f"{path}: exists; name another output or remove it")
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            messages = _Messages(Writer(file))
            _write_poses(messages, trajectory)
            _write_paths(messages, trajectory)
            if landmarks is not None:
                messages.landmarks(trajectory, landmarks)
            messages.finish()
        part.rename(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        part.unlink(missing_ok=True)
    return messages.count


def _write_poses(messages: _Messages, trajectory: Trajectory) -> None:
    t = _times(trajectory, RATE)
    T, twist, covariance = trajectory.pose(t), trajectory.velocity(t), trajectory.covariance(t)
    for row in zip(trajectory.stamps_ns(t).tolist(), T, twist, covariance, strict=True):
        messages.pose(*row)


def _write_paths(messages: _Messages, trajectory: Trajectory) -> None:
    t = _times(trajectory, PATH_RATE)
    stamps, T = trajectory.stamps_ns(t).tolist(), trajectory.pose(t)
    step = round(PATH_EVERY * PATH_RATE)
    for last in [*range(step, len(t), step), len(t)]:
        messages.path(stamps[:last], T[:last])


def _times(trajectory: Trajectory, rate: float) -> Array:
    return np.append(np.arange(trajectory.start, trajectory.stop, 1 / rate), trajectory.stop)


class _Messages:
    """Messages of one file."""

    def __init__(self, writer: Writer) -> None:
        self._writer, self.count = writer, 0
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._types = self._store.types
        writer.start(profile="ros2", library="gpvo")
        self._channels = {topic: self._channel(topic, kind) for topic, kind in TOPICS.items()}

    def pose(self, stamp_ns: int, T: Array, twist: Array, covariance: Array) -> None:
        """Write the pose and the velocity at one time."""
        stamped = self._stamped(stamp_ns, T)
        self._add("/gpvo/odometry", stamp_ns, self._odometry(stamped, twist, covariance))
        self._add("/gpvo/pose", stamp_ns, stamped)
        transforms = [self._transform(stamped, T)]
        self._add("/tf", stamp_ns, self._make("tf2_msgs/msg/TFMessage", transforms=transforms))

    def _odometry(self, stamped: Any, twist: Array, covariance: Array) -> Any:
        order = np.concatenate([ROS_ORDER, 6 + ROS_ORDER])
        ros = covariance[np.ix_(order, order)]
        return self._make(
            "nav_msgs/msg/Odometry",
            header=stamped.header,
            child_frame_id=CAMERA,
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=stamped.pose,
                covariance=ros[:6, :6].ravel(),
            ),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self._make(
                    "geometry_msgs/msg/Twist",
                    linear=self._vector(twist[3:]),
                    angular=self._vector(twist[:3]),
                ),
                covariance=ros[6:, 6:].ravel(),
            ),
        )

    def _transform(self, stamped: Any, T: Array) -> Any:
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=stamped.header,
            child_frame_id=CAMERA,
            transform=self._make(
                "geometry_msgs/msg/Transform",
                translation=self._vector(T[:3, 3]),
                rotation=stamped.pose.orientation,
            ),
        )

    def path(self, stamps_ns: list[int], T: Array) -> None:
        """Write the path up to its last pose."""
        poses = [self._stamped(stamp, pose) for stamp, pose in zip(stamps_ns, T, strict=True)]
        header = self._header(stamps_ns[-1])
        message = self._make("nav_msgs/msg/Path", header=header, poses=poses)
        self._add("/gpvo/path", stamps_ns[-1], message)

    def landmarks(self, trajectory: Trajectory, landmarks: LandmarkMap) -> None:
        """Write the map, with deviations, at the trajectory's end."""
        rows = np.column_stack([landmarks.position, landmarks.deviation]).astype("<f4")
        fields = [
            self._make("sensor_msgs/msg/PointField", name=name, offset=4 * k, datatype=7, count=1)
            for k, name in enumerate(("x", "y", "z", "deviation"))
        ]
        stamp_ns = int(trajectory.stamps_ns(trajectory.stop))
        cloud = self._make(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(stamp_ns),
            height=1,
            width=len(rows),
            fields=fields,
            is_bigendian=False,
            point_step=16,
            row_step=16 * len(rows),
            data=np.frombuffer(rows.tobytes(), np.uint8),
            is_dense=True,
        )
        self._add("/gpvo/landmarks", stamp_ns, cloud)

    def finish(self) -> None:
        """Finish the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, kind: str) -> int:
        text, _ = self._store.generate_msgdef(kind, ros_version=2)
        schema = self._writer.register_schema(kind, "ros2msg", text.encode())
        return self._writer.register_channel(topic, "cdr", schema)

    def _add(self, topic: str, stamp_ns: int, message: Any) -> None:
        data = bytes(self._store.serialize_cdr(message, TOPICS[topic]))
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)
        self.count += 1

    def _make(self, kind: str, **values: Any) -> Any:
        return self._types[kind](**values)

    def _header(self, stamp_ns: int) -> Any:
        sec, nanosec = divmod(stamp_ns, 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=WORLD)

    def _vector(self, values: Array) -> Any:
        x, y, z = values.tolist()
        return self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _pose(self, T: Array) -> Any:
        x, y, z = T[:3, 3].tolist()
        qx, qy, qz, qw = quaternions(T[None, :3, :3])[0].tolist()
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )

    def _stamped(self, stamp_ns: int, T: Array) -> Any:
        header = self._header(stamp_ns)
        return self._make("geometry_msgs/msg/PoseStamped", header=header, pose=self._pose(T))
