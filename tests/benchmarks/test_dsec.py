"""The DSEC benchmark from files in DSEC's layout to the tables."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import h5py
import hdf5plugin
import numpy as np
import pytest
import yaml
from rich.console import Console
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from benchmarks.dsec import main
from gpvo.errors import InputError
from gpvo.recordings import Events, StereoRig
from gpvo.simulation import SimulatedRecording
from gpvo.trajectory import StampedPoses, write_tum
from gpvo.trajectory.stamped_poses import rigid_transforms

NAME = "zurich_city_04_a"


def write_events(path: Path, events: Events, start_ns: int) -> None:
    """DSEC's events.h5: compressed columns, microseconds from an offset, index by millisecond."""
    t = np.rint(events.t * 1e6).astype(np.uint32)
    columns = {"x": events.x, "y": events.y, "t": t, "p": events.polarity.astype(np.uint8)}
    path.parent.mkdir(parents=True)
    with h5py.File(path, "w") as file:
        for name, column in columns.items():
            file.create_dataset(f"events/{name}", data=column, **hdf5plugin.Blosc(cname="zstd"))
        file["t_offset"] = np.int64(start_ns // 1000)
        file["ms_to_idx"] = np.searchsorted(t, 1000 * np.arange(t[-1] // 1000 + 1))


def write_calibration(path: Path, rig: StereoRig) -> None:
    """DSEC's cam_to_cam.yaml of an ideal rig; the frame cameras 1 and 2 stand with their events."""
    numbers = [rig.focal_length, rig.focal_length, *rig.principal_point]
    camera = {
        "camera_matrix": numbers,
        "distortion_model": "radtan",
        "distortion_coeffs": [0.0] * 4,
        "resolution": list(rig.resolution),
    }
    T_right_left = np.eye(4)
    T_right_left[0, 3] = -rig.baseline
    same = np.eye(4).tolist()
    transforms = {"T_10": same, "T_21": T_right_left.tolist(), "T_32": same}
    rotations = {f"R_rect{number}": np.eye(3).tolist() for number in range(4)}
    rectified = {f"camRect{number}": {"camera_matrix": numbers} for number in range(4)}
    cameras = {f"cam{number}": camera for number in range(4)}
    content = {"intrinsics": cameras | rectified, "extrinsics": transforms | rotations}
    path.parent.mkdir(parents=True)
    path.write_text(yaml.safe_dump(content))


T_LIDAR_LEFT = rigid_transforms(
    Rotation.from_rotvec([[1.1, -1.0, 1.2]]).as_matrix(), np.array([[0.1, -0.05, 0.2]])
)[0]


def write_lidar_odometry(path: Path, truth: StampedPoses) -> None:
    """The pose bag of a lidar that the left camera is fixed to, from 10 Hz poses."""
    store = get_typestore(Stores.ROS1_NOETIC)
    names = ("PoseStamped", "Pose", "Point", "Quaternion")
    stamped, pose, point, quaternion = (store.types[f"geometry_msgs/msg/{name}"] for name in names)
    header = store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    lidar = truth.seen_from(np.linalg.inv(T_LIDAR_LEFT))[::8]
    path.parent.mkdir(parents=True)
    with Writer(path) as bag:
        connection = bag.add_connection("/pose", stamped.__msgtype__, typestore=store)
        for stamp, T in zip(lidar.stamps_ns, lidar.T_world_cam, strict=True):
            turn = quaternion(*Rotation.from_matrix(T[:3, :3]).as_quat())
            head = header(seq=0, stamp=time(*divmod(int(stamp), 10**9)), frame_id="map")
            message = stamped(head, pose(point(*T[:3, 3]), turn))
            bag.write(connection, int(stamp), store.serialize_ros1(message, stamped.__msgtype__))


@pytest.fixture
def data(recording: SimulatedRecording, tmp_path: Path) -> Path:
    """A folder like DSEC's, with trajectories and a sparse ground truth beside it."""
    sequence = tmp_path / "dsec" / "train" / NAME
    for side in ("left", "right"):
        events = getattr(recording, side)
        write_events(sequence / "events" / side / "events.h5", events, recording.start_ns)
    write_calibration(sequence / "calibration" / "cam_to_cam.yaml", recording.rig)
    others = tmp_path / "others" / f"dsec_{NAME}"
    others.mkdir(parents=True)
    write_tum(others / "stamped_groundtruth.txt", recording.ground_truth[::8])
    write_tum(others / "esvo.txt", recording.ground_truth[10:-10:3])
    return tmp_path


def test_tables_from_files_in_dsecs_layout(data: Path, config_file: Path) -> None:
    text = StringIO()
    options = ["--data", data / "dsec", "--trajectories", data / "others", "--config", config_file]
    (outcome,) = main(list(map(str, options)), Console(file=text, width=120))
    ours, esvo = outcome.comparison.evaluations
    assert (ours.name, esvo.name) == ("gpvo", "esvo")
    assert ours.ate["se3"].translation.rmse < 0.05
    assert outcome.run.cost.events > 10_000
    for word in ("ESVIO_AA (published)", "3.7400 m", "1.0800 m", "body offset removed"):
        assert word in " ".join(text.getvalue().split())


def test_truth_from_the_odometry_of_a_lidar(
    recording: SimulatedRecording, data: Path, config_file: Path
) -> None:
    """Named as where such poses are published, and turned into those of the left event camera."""
    write_lidar_odometry(data / "dsec/zurich_city_04-odometry/pose.bag", recording.ground_truth)
    options = ["--data", str(data / "dsec"), "--config", str(config_file)]
    with pytest.raises(InputError, match=r"holds no cam_to_lidar\.yaml; put"):
        main(options)
    lidar = {"T_lidar_camRect1": T_LIDAR_LEFT.tolist()}
    path = data / "dsec/train" / NAME / "calibration/cam_to_lidar.yaml"
    path.write_text(yaml.safe_dump(lidar))
    (outcome,) = main(options, Console(file=StringIO()))
    (ours,) = outcome.comparison.evaluations
    truth = recording.ground_truth.interpolate(ours.ground_truth.stamps_ns)
    np.testing.assert_allclose(ours.ground_truth.T_world_cam, truth.T_world_cam, atol=0.01)
    assert ours.ate["se3"].translation.rmse < 0.05


def test_what_is_missing_is_said(data: Path) -> None:
    with pytest.raises(InputError, match="holds no zurich_city_11_a/events/left"):
        main(["--data", str(data / "dsec"), "--sequences", "zurich_city_11_a"])
    with pytest.raises(InputError, match="DSEC has no poses"):
        main(["--data", str(data / "dsec")])
    with pytest.raises(InputError, match="known are zurich_city_04_a"):
        main(["--data", str(data / "dsec"), "--sequences", "interlaken_00_a"])
