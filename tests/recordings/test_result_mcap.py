"""A result as MCAP: what rosbags reads is the trajectory and the map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.mapping import LandmarkMap
from gpvo.recordings.writing.result_mcap import RATE, ROS_ORDER, TOPICS, write_result_mcap
from gpvo.trajectory import Trajectory


@pytest.fixture
def trajectory() -> Trajectory:
    """Make a motion of three seconds with a covariance of which every entry differs."""
    t, T = np.linspace(0, 3, 31), np.tile(np.eye(4), (31, 1, 1))
    T[:, 0, 3] = 0.5 * t
    root = np.random.default_rng(0).standard_normal((24, 24))
    joint = np.tile(1e-4 * root @ root.T, (30, 1, 1))
    twist = np.tile([0.0, 0, 0, 0.5, 0, 0], (31, 1))
    return Trajectory(10**18 + 7, t, T, twist, np.ones(6), np.arange(31), joint, np.ones(31))


def landmarks() -> LandmarkMap:
    count = np.arange(5)
    position = np.random.default_rng(1).standard_normal((5, 3))
    covariance = np.tile(1e-4 * np.eye(3), (5, 1, 1))
    return LandmarkMap(
        count, position, covariance, count + 4, 0.1 * count, 0.2 * count, 1.0 + count
    )


def messages(path: Path) -> dict[str, list]:
    """Return (stamp, message) by topic, decoded by the definitions in the file."""
    store, found = get_typestore(Stores.ROS2_HUMBLE), {topic: [] for topic in TOPICS}
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message in reader.iter_messages():
            assert schema.encoding == "ros2msg" and schema.name == TOPICS[channel.topic]
            decoded = store.deserialize_cdr(message.data, schema.name)
            found[channel.topic].append((message.log_time, decoded))
    return found


def test_messages_are_the_trajectory_and_the_map(trajectory: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    count = write_result_mcap(path, trajectory, landmarks())
    found = messages(path)
    assert count == sum(map(len, found.values()))
    odometry = found["/gpvo/odometry"]
    assert len(odometry) == len(found["/gpvo/pose"]) == len(found["/tf"]) == 3 * RATE + 1
    for stamp, one in odometry[::37]:
        t = (stamp - trajectory.start_ns) * 1e-9
        assert (one.header.stamp.sec, one.header.stamp.nanosec) == divmod(stamp, 10**9)
        T, pose = trajectory.pose(t), one.pose.pose
        np.testing.assert_allclose(
            [pose.position.x, pose.position.y, pose.position.z], T[:3, 3], atol=1e-8
        )
        q = pose.orientation
        rotation = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        np.testing.assert_allclose(rotation, T[:3, :3], atol=1e-8)
        covariance = trajectory.covariance(t)[:6, :6][np.ix_(ROS_ORDER, ROS_ORDER)]
        np.testing.assert_allclose(one.pose.covariance.reshape(6, 6), covariance, rtol=1e-5)
        assert one.twist.twist.linear.x == pytest.approx(0.5)
    lengths = [len(path.poses) for _, path in found["/gpvo/path"]]
    assert lengths == sorted(lengths) and lengths[-1] == 61
    ((_, cloud),) = found["/gpvo/landmarks"]
    points = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(cloud.width, 4)
    np.testing.assert_allclose(points[:, :3], landmarks().position, rtol=1e-6)
    np.testing.assert_allclose(points[:, 3], landmarks().deviation, rtol=1e-6)


def test_without_a_map_there_are_no_landmarks_and_nothing_is_overwritten(
    trajectory: Trajectory, tmp_path: Path
) -> None:
    path = tmp_path / "out.mcap"
    write_result_mcap(path, trajectory, None)
    assert messages(path)["/gpvo/landmarks"] == []
    with pytest.raises(InputError, match=r"out\.mcap: exists"):
        write_result_mcap(path, trajectory, None)
