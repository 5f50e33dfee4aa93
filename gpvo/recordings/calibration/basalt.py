"""Read basalt's calibration (JSON), as in TUM-VIE: cameras 2 and 3 are the event cameras."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpvo.recordings.calibration.fields import Fields
from gpvo.recordings.calibration.rectification import rectified_rig
from gpvo.recordings.calibration.rig import Camera, StereoRig

EXPECTED = "a basalt calibration (JSON)"
POSE = ("px", "py", "pz", "qx", "qy", "qz", "qw")
KB4 = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")


def basalt_rig(fields: Fields) -> StereoRig:
    """Return the rig of the last two cameras of the file."""
    value = fields.mapping("value0")
    poses = _list(value, "T_imu_cam")
    left, right = len(poses) - 2, len(poses) - 1
    if left < 0:
        value.fail("T_imu_cam", "must hold two cameras")
    T_right_left = np.linalg.inv(_pose(poses[right])) @ _pose(poses[left])
    cameras = _camera(value, left), _camera(value, right)
    return rectified_rig(*cameras, T_right_left, value, "T_imu_cam")


def imu_to_left(fields: Fields) -> NDArray[np.float64]:
    """Return T_imu_left (4, 4) of the raw left event camera."""
    poses = _list(fields.mapping("value0"), "T_imu_cam")
    if len(poses) < 2:
        fields.fail("value0/T_imu_cam", "must hold two cameras")
    return _pose(poses[-2])


def imu_to_marker(fields: Fields) -> NDArray[np.float64]:
    """Return T_imu_marker (4, 4) of TUM-VIE's mocap-imu-calibration."""
    value = fields.mapping("value0")
    return _pose(value.mapping("T_imu_marker"))


def _camera(value: Fields, number: int) -> Camera:
    intrinsics = _list(value, "intrinsics")
    if number >= len(intrinsics):
        value.fail("intrinsics", f"has no camera {number}")
    fields = intrinsics[number]
    if fields.get("camera_type") != "kb4":
        fields.fail("camera_type", f"is {fields.values['camera_type']!r}; only kb4 is known")
    numbers = _numbers(fields.mapping("intrinsics"), KB4)
    sizes = value.get("resolution")
    if not isinstance(sizes, list) or number >= len(sizes):
        value.fail("resolution", f"has no camera {number}")
    size = Fields(value.path, f"{value.name}/resolution", {number: sizes[number]}, EXPECTED)
    resolution = size.resolution(number)
    fields.check_lens("intrinsics", numbers[:4], resolution)
    return Camera(resolution, numbers[:4], "equidistant", numbers[4:], np.eye(3))


def _list(value: Fields, field: str) -> list[Fields]:
    """Return the fields of each mapping in a list."""
    items: Any = value.get(field)
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        value.fail(field, "must list the cameras")
    return [
        Fields(value.path, f"{value.name}/{field}/{number}", item, EXPECTED)
        for number, item in enumerate(items)
    ]


def _pose(fields: Fields) -> NDArray[np.float64]:
    numbers = _numbers(fields, POSE)
    if abs(np.linalg.norm(numbers[3:]) - 1.0) > 1e-2:
        fields.fail("qw", "and the others are no unit quaternion")
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(numbers[3:]).as_matrix()
    T[:3, 3] = numbers[:3]
    return T


def _numbers(fields: Fields, names: tuple[str, ...]) -> NDArray[np.float64]:
    return np.array([float(fields.array(name, ())) for name in names])
