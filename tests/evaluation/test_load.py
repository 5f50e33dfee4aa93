"""Poses of every format that users have, good and bad."""

from decimal import Decimal
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.evaluation.poses.load import load_poses
from gpvo.trajectory import write_tum


@pytest.fixture
def poses(random_walk):
    return random_walk(1, 40)


def assert_same(read, written, tolerance=1e-8):
    np.testing.assert_array_equal(read.stamps_ns, written.stamps_ns)
    np.testing.assert_allclose(read.T_world_cam, written.T_world_cam, atol=tolerance)


def test_tum_file_and_result_folder(poses, tmp_path):
    write_tum(tmp_path / "trajectory.tum", poses)
    assert_same(load_poses(tmp_path / "trajectory.tum"), poses)
    assert_same(load_poses(tmp_path), poses)


def test_rpg_folder(poses, tmp_path):
    write_tum(tmp_path / "stamped_traj_estimate.txt", poses)
    assert_same(load_poses(tmp_path), poses)


def test_kitti_file(poses, tmp_path):
    np.savetxt(tmp_path / "00.txt", poses.T_world_cam[:, :3].reshape(-1, 12))
    read = load_poses(tmp_path / "00.txt")
    np.testing.assert_allclose(read.T_world_cam, poses.T_world_cam, atol=1e-12)
    assert (np.diff(read.stamps_ns) == 100_000_000).all()
    np.savetxt(tmp_path / "times.txt", poses.seconds)
    np.testing.assert_array_equal(
        load_poses(tmp_path / "00.txt").stamps_ns, poses.stamps_ns - poses.stamps_ns[0]
    )
    np.savetxt(tmp_path / "times.txt", poses.seconds[:-1])
    with pytest.raises(InputError, match="39 times for the 40 poses"):
        load_poses(tmp_path / "00.txt")


def write_kitti(folder, times):
    poses = np.tile(np.eye(4)[:3].ravel(), (len(times), 1))
    np.savetxt(folder / "00.txt", poses)
    (folder / "times.txt").write_text("".join(f"{time}\n" for time in times))
    return folder / "00.txt"


def test_the_times_of_kitti_are_exact(tmp_path):
    times = ["1600000000.123456789", "1600000000.123456790", "1.600000001e+09  # later"]
    found = load_poses(write_kitti(tmp_path, times)).stamps_ns
    assert (found - 1_600_000_000 * 10**9).tolist() == [123_456_789, 123_456_790, 10**9]


@pytest.mark.parametrize(
    "times", [["0", "nan"], ["0", "1e30"], ["0", "a"], ["0", "1 2"], ["1", "1"]]
)
def test_bad_times_of_kitti_are_named(tmp_path, times):
    with pytest.raises(InputError, match=r"times\.txt: "):
        load_poses(write_kitti(tmp_path, times))


def test_no_times_of_kitti_are_named(tmp_path):
    path = write_kitti(tmp_path, ["0", "1"])
    (tmp_path / "times.txt").write_text("")
    with pytest.raises(InputError, match=r"times\.txt: has 0 times for the 2 poses"):
        load_poses(path)


@pytest.mark.parametrize("between", [" ", ",", ", ", "\t"])
@pytest.mark.parametrize("stamps", [(1.6e15, 1.6e15 + 2e5), (1.6e9, 1.6e9 + 0.2)])
def test_stamps_as_numpy_writes_them(tmp_path, stamps, between):
    """Seconds or microseconds, 1.6e+15, between commas or spaces."""
    rows = np.zeros((2, 8))
    rows[:, 0], rows[:, 7] = stamps, 1.0
    np.savetxt(tmp_path / "poses.txt", rows, delimiter=between)
    found = load_poses(tmp_path / "poses.txt")
    assert found.stamps_ns[0] == 1_600_000_000_000_000_000
    assert np.diff(found.stamps_ns)[0] == pytest.approx(200_000_000, abs=100)


EPOCH_NS = 1_504_645_177_422_123_000


@pytest.mark.parametrize(
    ("unit_ns", "start"),
    [(1, 0), (1000, 0), (10**9, 0), *((10**k, EPOCH_NS) for k in (0, 3, 6, 9))],
)
def test_stamps_of_any_unit(tmp_path, unit_ns, start):
    """Since 1970 or the start, in seconds, milliseconds, microseconds or nanoseconds."""
    stamps_ns = start + np.arange(20) * 10_000_000
    path = tmp_path / "poses.txt"
    path.write_text("".join(f"{Decimal(int(t)) / unit_ns:f} 0 0 0 0 0 0 1\n" for t in stamps_ns))
    np.testing.assert_array_equal(load_poses(path).stamps_ns, stamps_ns)


@pytest.mark.parametrize(
    "heading",
    [
        "#timestamp [ns],p_R_x,p_R_y,p_R_z,q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
        "timestamp tx ty tz qw qx qy qz",
    ],
)
def test_a_heading_with_qw_first(tmp_path, heading):
    path = tmp_path / "poses.csv"
    path.write_text(f"{heading}\n1.5,1,2,3,0.8,0.6,0,0\n1.6,1,2,3,0.8,0.6,0,0\n")
    turned = Rotation.from_quat([0.6, 0.0, 0.0, 0.8]).as_matrix()
    np.testing.assert_allclose(load_poses(path).rotations[1], turned, atol=1e-12)
    path.write_text("# t tx ty tz qx qy qz qw\n1.5,1,2,3,0.6,0,0,0.8\n1.6,1,2,3,0.6,0,0,0.8\n")
    np.testing.assert_allclose(load_poses(path).rotations[1], turned, atol=1e-12)


def test_mvsec_ground_truth_is_turned_into_the_rectified_camera(poses, tmp_path):
    R_rect = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    rig = SimpleNamespace(left=SimpleNamespace(R_rect=R_rect))
    path = tmp_path / "room_gt.hdf5"
    with h5py.File(path, "w") as file:
        file["davis/left/pose"] = poses.T_world_cam
        file["davis/left/pose_ts"] = poses.stamps_ns * 1e-9
    read = load_poses(path, rig)
    np.testing.assert_allclose(read.rotations @ R_rect, poses.rotations, atol=1e-12)
    np.testing.assert_allclose(read.positions, poses.positions, atol=1e-12)
    np.testing.assert_allclose(read.stamps_ns, poses.stamps_ns, atol=200)
    with pytest.raises(InputError, match="calibration"):
        load_poses(path)
    with h5py.File(path, "a") as file:
        del file["davis/left/pose_ts"]
    with pytest.raises(InputError, match="pose_ts"):
        load_poses(path, rig)


def pose_message(store, kind, stamp_ns, T, ros1):
    types = store.types
    header = {"seq": 0} if ros1 else {}
    stamp = types["builtin_interfaces/msg/Time"](
        sec=int(stamp_ns // 10**9), nanosec=int(stamp_ns % 10**9)
    )
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="world", **header)
    q = Rotation.from_matrix(T[:3, :3]).as_quat()
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](*T[:3, 3]),
        orientation=types["geometry_msgs/msg/Quaternion"](*q),
    )
    if kind == "geometry_msgs/msg/PoseStamped":
        return types[kind](header=header, pose=pose)
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    return types[kind](
        header=header,
        child_frame_id="camera",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](
            twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero),
            covariance=np.zeros(36),
        ),
    )


def write_bag(path, topics, poses, version):
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    options = {} if version == 1 else {"version": 9, "storage_plugin": StoragePlugin.SQLITE3}
    serialize = store.serialize_ros1 if version == 1 else store.serialize_cdr
    with (Rosbag1Writer if version == 1 else Rosbag2Writer)(path, **options) as writer:
        for topic, kind in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for stamp, T in zip(poses.stamps_ns.tolist(), poses.T_world_cam, strict=True):
                message = pose_message(store, kind, stamp, T, version == 1)
                writer.write(connection, stamp + 5_000_000, serialize(message, kind))
    return path


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("kind", ["geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"])
def test_ros_bags(poses, tmp_path, version, kind):
    path = write_bag(
        tmp_path / ("ros1.bag" if version == 1 else "ros2"), {"/pose": kind}, poses, version
    )
    assert_same(load_poses(path), poses, 1e-12)


def test_a_bag_with_several_topics_asks_which(poses, tmp_path):
    topics = dict.fromkeys(
        ("/davis/left/pose", "/davis/right/pose"), "geometry_msgs/msg/PoseStamped"
    )
    path = write_bag(tmp_path / "poses.bag", topics, poses, 1)
    with pytest.raises(InputError, match=r"poses\.bag:/davis/left/pose .*\.bag:/davis/right/pose"):
        load_poses(path)
    assert_same(load_poses(f"{path}:/davis/right/pose"), poses, 1e-12)
    with pytest.raises(InputError, match="name one pose topic"):
        load_poses(f"{path}:/other")


def test_what_cannot_be_read_is_named(poses, tmp_path):
    (tmp_path / "broken.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    (tmp_path / "other.txt").write_text("1 2 3\n")
    (tmp_path / "kitti.txt").write_text(" ".join(["0"] * 12) + "\n1 2\n")
    (tmp_path / "flat.txt").write_text(" ".join(["0"] * 12) + "\n")
    (tmp_path / "mirror.txt").write_text("1 0 0 0  0 1 0 0  0 0 -1 0\n" * 2)
    (tmp_path / "noise.bin").write_bytes(bytes(range(128, 256)))
    (tmp_path / "folder").mkdir()
    texts = ("other.txt", "kitti.txt", "flat.txt", "mirror.txt")
    for name in ("broken.bag", *texts, "noise.bin", "folder", "none"):
        with pytest.raises(InputError, match=name):
            load_poses(tmp_path / name)


def test_a_truncated_bag_is_named(poses, tmp_path):
    path = write_bag(tmp_path / "cut.bag", {"/pose": "geometry_msgs/msg/PoseStamped"}, poses, 1)
    data = path.read_bytes()
    for part in (0.1, 0.5, 0.99):
        path.write_bytes(data[: int(part * len(data))])
        with pytest.raises(InputError, match=r"cut\.bag"):
            load_poses(path)
