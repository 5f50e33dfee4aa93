"""Ground truths of every dataset give the motion of the rectified left event camera."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_files import header, types, write_rosbag1
from encoders import START_NS
from scipy.spatial.transform import Rotation
from test_calibrations import T_RIGHT_LEFT, basalt, dsec, reference, turned

from gpvo.errors import InputError
from gpvo.evaluation.poses.load import load_poses
from gpvo.recordings import StereoRig
from gpvo.trajectory import StampedPoses

STAMPS = START_NS + 8_333_000 * np.arange(40)
T_WORLD_LEFT = np.stack([turned(3.0 * i, 0.02 * i, -0.01 * i, 0.3) for i in range(40)])


def rows(T_world_body: np.ndarray) -> np.ndarray:
    """Return positions and quaternions (N, 7)."""
    quaternions = Rotation.from_matrix(T_world_body[:, :3, :3]).as_quat()
    return np.hstack([T_world_body[:, :3, 3], quaternions])


def rectified(rig: StereoRig) -> np.ndarray:
    T_raw_rect = np.eye(4)
    T_raw_rect[:3, :3] = rig.left.R_rect.T
    return T_raw_rect


def assert_left_camera(poses: StampedPoses, atol: float = 1e-6) -> None:
    np.testing.assert_array_equal(poses.stamps_ns, STAMPS)
    np.testing.assert_allclose(poses.T_world_cam, T_WORLD_LEFT, atol=atol)


def pose_bag(path: Path, topics: dict[str, np.ndarray]) -> Path:
    """Write a bag with PoseStamped messages on every topic."""
    store = types(True)
    names = ("PoseStamped", "Pose", "Point", "Quaternion")
    stamped, pose, point, quaternion = (store.types[f"geometry_msgs/msg/{n}"] for n in names)
    messages = []
    for topic, T_world_body in topics.items():
        for stamp, row in zip(STAMPS, rows(T_world_body), strict=True):
            one = pose(point(*row[:3]), quaternion(*row[3:]))
            message = stamped(header(store, stamp, "world", True), one)
            messages.append((topic, "geometry_msgs/msg/PoseStamped", int(stamp), message))
    return write_rosbag1(path, messages)


@pytest.fixture
def rig(write_camchain) -> StereoRig:  # type: ignore[no-untyped-def]
    return reference(write_camchain, "equidistant")


def test_mvsec_bag(tmp_path: Path, rig: StereoRig) -> None:
    """Of several topics, the pose of the raw left camera is read."""
    T_world_raw = T_WORLD_LEFT @ np.linalg.inv(rectified(rig))
    other = np.broadcast_to(np.eye(4), T_world_raw.shape)
    topics = {
        "/davis/left/odometry": other,
        "/davis/left/pose": T_world_raw,
        "/davis/right/pose": other,
    }
    path = pose_bag(tmp_path / "indoor_flying1_gt.bag", topics)
    assert_left_camera(load_poses(path, rig))
    with pytest.raises(InputError, match="--calibration"):
        load_poses(path)


def test_dsec_lidar(tmp_path: Path, rig: StereoRig) -> None:
    calibration = dsec(rig, T_RIGHT_LEFT)
    calibration["extrinsics"]["R_rect1"] = turned(4.0, 0, 0, 0)[:3, :3].tolist()
    T_lidar_camrect1 = turned(80.0, 0.3, -0.2, 0.5)
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration/cam_to_cam.yaml").write_text(yaml.safe_dump(calibration))
    lidar = yaml.safe_dump({"T_lidar_camRect1": T_lidar_camrect1.tolist()})
    (tmp_path / "calibration/cam_to_lidar.yaml").write_text(lidar)
    extrinsics = calibration["extrinsics"]
    R_rect0, R_rect1 = np.eye(4), np.eye(4)
    R_rect0[:3, :3], R_rect1[:3, :3] = extrinsics["R_rect0"], extrinsics["R_rect1"]
    # A point of the rectified left camera: to the raw one, to camera 1, rectified, to the lidar.
    T_lidar_left = T_lidar_camrect1 @ R_rect1 @ np.array(extrinsics["T_10"]) @ R_rect0.T
    T_world_lidar = T_WORLD_LEFT @ np.linalg.inv(T_lidar_left)
    path = pose_bag(tmp_path / "pose.bag", {"/pose": T_world_lidar})
    assert_left_camera(load_poses(path))
    # DSEC's sequences lie beside each other; a drive's poses for all of them have another folder.
    (tmp_path / "zurich_city_04_a").mkdir()
    (tmp_path / "calibration").rename(tmp_path / "zurich_city_04_a/calibration")
    events = tmp_path / "zurich_city_04_a/events/left/events.h5"
    (tmp_path / "zurich_city_04-odometry").mkdir()
    path = path.rename(tmp_path / "zurich_city_04-odometry/pose.bag")
    assert_left_camera(load_poses(path, beside=[events]))
    shutil.copytree(tmp_path / "zurich_city_04_a/calibration", tmp_path / "04_a_calibration")
    shutil.copytree(tmp_path / "zurich_city_04_a/calibration", tmp_path / "04_b_calibration")
    with pytest.raises(InputError, match=r"04_b_calibration/cam_to_lidar\.yaml\); give the right"):
        load_poses(path)
    assert_left_camera(load_poses(path, beside=[tmp_path / "04_b_calibration/cam_to_cam.yaml"]))


def test_bag_without_calibration_files_is_taken_as_it_is(tmp_path: Path) -> None:
    assert_left_camera(load_poses(pose_bag(tmp_path / "pose.bag", {"/pose": T_WORLD_LEFT})))


def microsecond_file(path: Path, T_world_body: np.ndarray) -> Path:
    lines = ["timestamp(us) px py pz qx qy qz qw"]
    for stamp, row in zip(STAMPS // 1000, rows(T_world_body), strict=True):
        lines.append(" ".join([str(stamp), *(f"{value:.9f}" for value in row)]))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_tum_vie(tmp_path: Path, rig: StereoRig) -> None:
    calibration = basalt(rig, T_RIGHT_LEFT)
    T_imu_left = turned(40.0, 0.1, 0.2, 0.3)
    T_imu_marker = turned(-70.0, 0.05, 0.0, -0.1)
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    marker = dict(zip(names, rows(T_imu_marker[None])[0].tolist(), strict=True))
    (tmp_path / "camera-calibrationA.json").write_text(json.dumps(calibration))
    mocap = json.dumps({"value0": {"T_imu_marker": marker}})
    (tmp_path / "mocap-imu-calibrationA.json").write_text(mocap)
    T_marker_left = np.linalg.inv(T_imu_marker) @ T_imu_left @ rectified(rig)
    path = microsecond_file(
        tmp_path / "mocap_data.txt", T_WORLD_LEFT @ np.linalg.inv(T_marker_left)
    )
    assert_left_camera(load_poses(path, rig))
    with pytest.raises(InputError, match="--calibration"):
        load_poses(path)
    estimate = microsecond_file(tmp_path / "estimate.txt", T_WORLD_LEFT)
    assert_left_camera(load_poses(estimate, rig))
    (tmp_path / "camera-calibrationB.json").write_text(json.dumps(calibration))
    with pytest.raises(InputError, match="several calibrations"):
        load_poses(path, rig)


def test_microseconds_without_calibration_files(tmp_path: Path) -> None:
    assert_left_camera(load_poses(microsecond_file(tmp_path / "mocap_data.txt", T_WORLD_LEFT)))


def test_vector(tmp_path: Path, rig: StereoRig) -> None:
    T_cam_body, T_cam0_cam2 = turned(100.0, 0.4, 0.1, 0.0), turned(2.0, 0.05, 0.0, 0.01)
    joint = {"cam2": {"T_cam0_cam2": T_cam0_cam2.tolist()}}
    (tmp_path / "small_scale_joint_camera_extrinsic_results.yaml").write_text(yaml.safe_dump(joint))
    mocap = {"cam0": {"T_cam_body": T_cam_body.tolist()}}
    (tmp_path / "camera_mocap_extrinsic_results1.yaml").write_text(yaml.safe_dump(mocap))
    T_body_left = np.linalg.inv(T_cam_body) @ T_cam0_cam2 @ rectified(rig)
    table = rows(T_WORLD_LEFT @ np.linalg.inv(T_body_left))
    lines = ["# mocap", "# timestamp tx ty tz qx qy qz qw"]
    for stamp, row in zip(STAMPS, table, strict=True):
        seconds = f"{stamp // 10**9}.{stamp % 10**9:09d}"
        lines.append(" ".join([seconds, *(f"{value:.9f}" for value in row)]))
    (tmp_path / "desk1.synced.gt.txt").write_text("\n".join(lines))
    assert_left_camera(load_poses(tmp_path / "desk1.synced.gt.txt", rig))
