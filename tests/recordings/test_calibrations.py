"""Every kind of calibration describes the same cameras as a kalibr camchain does."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from encoders import column_file, event_block
from recording_files import HEIGHT, WIDTH, camchain
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.recordings import StereoRig, open_recording, read_calibration
from gpvo.recordings.writing.writer import write_camchain as write_camchain_of_rig

Write = Callable[[Any], Path]


def turned(degrees: float, *t: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.deg2rad(degrees) * np.array([0.3, 0.9, -0.2])).as_matrix()
    T[:3, 3] = t
    return T


T_RIGHT_LEFT = turned(2.0, -0.1, 0.0004, 0.0001)
LENS = {"equidistant": [-0.05, 0.01, -0.05, 0.02], "radtan": [-0.2, 0.05, 0.001, -0.002]}


def reference(write_camchain: Write, model: str) -> StereoRig:
    content = camchain()
    for camera in content.values():
        camera |= {"distortion_model": model, "distortion_coeffs": LENS[model]}
    content["cam1"]["T_cn_cnm1"] = T_RIGHT_LEFT.tolist()
    return read_calibration(write_camchain(content))


def assert_same_rig(ours: StereoRig, theirs: StereoRig, atol: float = 1e-4) -> None:
    """Check that every raw pixel is rectified to the same place and the baselines agree."""
    assert ours.baseline == pytest.approx(theirs.baseline, abs=1e-6)
    assert ours.focal_length == pytest.approx(theirs.focal_length, abs=atol)
    for table, other in zip(ours.tables, theirs.tables, strict=True):
        np.testing.assert_allclose(table, other, rtol=1e-4, atol=10 * atol)


def dsec(rig: StereoRig, T_right_left: np.ndarray) -> dict[str, Any]:
    """Return a cam_to_cam.yaml with two frame cameras between the event cameras."""
    T_10, T_21 = turned(1.0, 0.02, 0.01, 0.0), turned(-3.0, -0.3, 0.0, 0.02)
    T_32 = T_right_left @ np.linalg.inv(T_21 @ T_10)
    cameras = {"cam0": rig.left, "cam1": rig.left, "cam2": rig.left, "cam3": rig.right}
    intrinsics: dict[str, Any] = {
        name: {
            "camera_matrix": camera.intrinsics.tolist(),
            "distortion_model": camera.distortion_model,
            "distortion_coeffs": camera.distortion.tolist(),
            "resolution": list(camera.resolution),
        }
        for name, camera in cameras.items()
    }
    f, (cx, cy) = rig.focal_length, rig.principal_point
    for number in range(4):
        intrinsics[f"camRect{number}"] = {"camera_matrix": [f, f, cx, cy]}
    extrinsics = {"T_10": T_10.tolist(), "T_21": T_21.tolist(), "T_32": T_32.tolist()}
    R = {"R_rect0": rig.left.R_rect.tolist(), "R_rect3": rig.right.R_rect.tolist()}
    R |= {"R_rect1": np.eye(3).tolist(), "R_rect2": np.eye(3).tolist()}
    return {"intrinsics": intrinsics, "extrinsics": extrinsics | R}


def basalt(rig: StereoRig, T_right_left: np.ndarray) -> dict[str, Any]:
    """Return TUM-VIE's four cameras, of which the last two are the event cameras."""
    T_imu_left = turned(40.0, 0.1, 0.2, 0.3)
    poses = [np.eye(4), np.eye(4), T_imu_left, T_imu_left @ np.linalg.inv(T_right_left)]
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    numbers = [*rig.left.intrinsics.tolist(), *rig.left.distortion.tolist()]
    lens = {"camera_type": "kb4", "intrinsics": dict(zip(names, numbers, strict=True))}
    return {
        "value0": {
            "T_imu_cam": [
                dict(zip(("px", "py", "pz"), T[:3, 3].tolist(), strict=True))
                | dict(
                    zip(
                        ("qx", "qy", "qz", "qw"),
                        Rotation.from_matrix(T[:3, :3]).as_quat().tolist(),
                        strict=True,
                    )
                )
                for T in poses
            ],
            "intrinsics": [lens] * 4,
            "resolution": [[1024, 1024], [1024, 1024], [WIDTH, HEIGHT], [WIDTH, HEIGHT]],
        }
    }


def camera_info(rig: StereoRig, side: str, rectified: bool) -> dict[str, Any]:
    camera = rig.left if side == "left" else rig.right
    model = {"radtan": "plumb_bob"}.get(camera.distortion_model, camera.distortion_model)
    P = np.column_stack([rig.K_rect, np.zeros(3)])
    P[0, 3] = -rig.focal_length * rig.baseline if side == "right" else 0.0
    R = camera.R_rect
    content: dict[str, Any] = {
        "image_width": WIDTH,
        "image_height": HEIGHT,
        "camera_name": side,
        "camera_matrix": {"rows": 3, "cols": 3, "data": camera.K.ravel().tolist()},
        "distortion_model": model,
        "distortion_coefficients": {"rows": 1, "cols": 4, "data": camera.distortion.tolist()},
    }
    if rectified:
        content["rectification_matrix"] = {"rows": 3, "cols": 3, "data": R.ravel().tolist()}
        content["projection_matrix"] = {"rows": 3, "cols": 4, "data": P.ravel().tolist()}
    else:
        content["T_right_left"] = {"rows": 3, "cols": 4, "data": T_RIGHT_LEFT[:3].ravel().tolist()}
    return content


@pytest.mark.parametrize("model", LENS)
def test_dsec(tmp_path: Path, write_camchain: Write, model: str) -> None:
    rig = reference(write_camchain, model)
    path = tmp_path / "cam_to_cam.yaml"
    path.write_text(yaml.safe_dump(dsec(rig, T_RIGHT_LEFT)))
    assert_same_rig(read_calibration(path), rig)


def test_basalt(tmp_path: Path, write_camchain: Write) -> None:
    rig = reference(write_camchain, "equidistant")
    path = tmp_path / "camera-calibrationA.json"
    path.write_text(json.dumps(basalt(rig, T_RIGHT_LEFT)))
    assert_same_rig(read_calibration(path), rig)


@pytest.mark.parametrize("model", LENS)
@pytest.mark.parametrize("rectified", [True, False])
def test_camera_info(tmp_path: Path, write_camchain: Write, model: str, rectified: bool) -> None:
    rig = reference(write_camchain, model)
    for side in ("left", "right"):
        text = yaml.safe_dump(camera_info(rig, side, rectified))
        text = text.replace("matrix:", "matrix: !!opencv-matrix")
        text = text.replace("coefficients:", "coefficients: !!opencv-nd-matrix")
        (tmp_path / f"{side}.yaml").write_text(f"%YAML:1.0\n---\n{text}")
    for path in (tmp_path / "left.yaml", tmp_path / "right.yaml"):
        assert_same_rig(read_calibration(path), rig)


def test_vector(tmp_path: Path, write_camchain: Write) -> None:
    """The CameraInfo are of single cameras, and one file has the poses of all cameras."""
    rig = reference(write_camchain, "radtan")
    T_cam0_left = turned(20.0, 0.1, 0.0, 0.02)
    for side, camera in (("left", rig.left), ("right", rig.right)):
        content = camera_info(rig, side, True)
        content["rectification_matrix"]["data"] = np.eye(3).ravel().tolist()
        P = np.column_stack([camera.K, np.zeros(3)])
        content["projection_matrix"]["data"] = P.ravel().tolist()
        (tmp_path / f"{side}_event_camera.yaml").write_text(yaml.safe_dump(content))
    joint = {
        "cam2": {"T_cam0_cam2": T_cam0_left.tolist()},
        "cam3": {"T_cam0_cam3": (T_cam0_left @ np.linalg.inv(T_RIGHT_LEFT)).tolist()},
    }
    path = tmp_path / "small_scale_joint_camera_extrinsic_results.yaml"
    path.write_text(yaml.safe_dump(joint))
    assert_same_rig(read_calibration(tmp_path / "left_event_camera.yaml"), rig)


@pytest.mark.parametrize("model", LENS)
def test_camchains_that_we_write(tmp_path: Path, write_camchain: Write, model: str) -> None:
    """The rig is read from its rectification and, without that, from T_cn_cnm1."""
    rig = reference(write_camchain, model)
    path = tmp_path / "written.camchain.yaml"
    write_camchain_of_rig(path, rig)
    assert_same_rig(read_calibration(path), rig, atol=1e-12)
    content = yaml.safe_load(path.read_text())
    for camera in content.values():
        del camera["rectification_matrix"], camera["projection_matrix"]
    path.write_text(yaml.safe_dump(content))
    assert_same_rig(read_calibration(path), rig)


def test_calibration_beside_the_recording(tmp_path: Path, write_camchain: Write) -> None:
    rig = reference(write_camchain, "radtan")
    folder = tmp_path / "zurich"
    left, right = event_block(400, 1), event_block(400, 2)
    for side, block in (("left", left), ("right", right)):
        column_file(folder / f"events/{side}/events.h5", block)
    (folder / "zurich_calibration").mkdir()
    (folder / "zurich_calibration/cam_to_cam.yaml").write_text(
        yaml.safe_dump(dsec(rig, T_RIGHT_LEFT))
    )
    for path in (folder, folder / "events/left/events.h5"):
        assert_same_rig(open_recording(path).rig, rig)
    (folder / "another_camchain.yaml").write_text(yaml.safe_dump(camchain()))
    with pytest.raises(InputError, match=r"--calibration .*cam_to_cam.yaml or --calibration"):
        open_recording(folder)


def broken(content: dict[str, Any], place: str, value: Any) -> dict[str, Any]:
    """Return the content with one field replaced, or removed if the value is None."""
    content = json.loads(json.dumps(content))
    *parents, last = place.split("/")
    at: Any = content
    for name in parents:
        at = at[int(name)] if isinstance(at, list) else at[name]
    if value is None:
        del at[int(last) if isinstance(at, list) else last]
    else:
        at[int(last) if isinstance(at, list) else last] = value
    return content


R_ELSEWHERE = turned(60.0, 0.0, 0.0, 0.0)[:3, :3].tolist()

FAULTS = [
    ("dsec", "intrinsics/cam3", None, "intrinsics/cam3 is missing"),
    ("dsec", "intrinsics/cam0/camera_matrix", [1, 2, 3], "intrinsics/cam0/camera_matrix must be 4"),
    ("dsec", "extrinsics/T_21", np.ones((4, 4)).tolist(), "extrinsics/T_21 is not a rotation"),
    (
        "dsec",
        "extrinsics/R_rect3",
        R_ELSEWHERE,
        "extrinsics/R_rect3 does not",
    ),
    ("dsec", "intrinsics/camRect0/camera_matrix", [50, 60, 1, 1], "T_10, T_21, T_32 does not give"),
    ("basalt", "value0/T_imu_cam", [{}], "value0/T_imu_cam must hold two cameras"),
    ("basalt", "value0/T_imu_cam/3/qw", 5.0, "value0/T_imu_cam/3/qw"),
    ("basalt", "value0/T_imu_cam/3/px", None, "value0/T_imu_cam/3/px is missing"),
    ("basalt", "value0/intrinsics/2/camera_type", "ds", "camera_type is 'ds'; only kb4"),
    ("basalt", "value0/intrinsics/2/intrinsics/fx", -1.0, "focal length"),
    ("basalt", "value0/resolution", [[64, 48]], "value0/resolution has no camera 2"),
    ("basalt", "value0/resolution/2", ["wide", 48], "value0/resolution/2 must be 2 numbers"),
    ("basalt", "value0", 3, "value0 must hold"),
    ("info", "camera_matrix/data", [1.0] * 8, "camera_matrix/data must be 9 numbers"),
    ("info", "distortion_model", "fov", "distortion_model is 'fov'"),
    ("info", "image_width", 64.5, "image_width must be whole pixels"),
    ("info", "rectification_matrix/data", [2.0] * 9, "rectification_matrix is not a rotation"),
    ("info", "projection_matrix", None, "T_right_left is missing"),
]


@pytest.mark.parametrize(("kind", "place", "value", "problem"), FAULTS, ids=range(len(FAULTS)))
def test_faults(
    tmp_path: Path, write_camchain: Write, kind: str, place: str, value: Any, problem: str
) -> None:
    rig = reference(write_camchain, "equidistant")
    if kind == "info":
        (tmp_path / "right.yaml").write_text(yaml.safe_dump(camera_info(rig, "right", True)))
        content = camera_info(rig, "left", True)
    else:
        content = {"dsec": dsec, "basalt": basalt}[kind](rig, T_RIGHT_LEFT)
    path = tmp_path / ("left.json" if kind == "basalt" else "left.yaml")
    path.write_text(json.dumps(broken(content, place, value)))
    with pytest.raises(InputError) as caught:
        read_calibration(path)
    message = str(caught.value)
    assert problem in message and message.startswith(str(tmp_path)) and "\n" not in message


def test_nothing_in_a_calibration_runs(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    path = tmp_path / "a.yaml"
    path.write_text(f"!!python/object/apply:os.system ['touch {mark}']")
    with pytest.raises(InputError, match="not valid YAML"):
        read_calibration(path)
    assert not mark.exists()


def test_bombs_are_refused_or_small(tmp_path: Path) -> None:
    """Deeply nested JSON is one error, not a crash."""
    path = tmp_path / "a.json"
    path.write_text("[" * 100_000)
    with pytest.raises(InputError, match="not valid JSON"):
        read_calibration(path)


def test_the_other_camera_info_is_missing(tmp_path: Path, write_camchain: Write) -> None:
    rig = reference(write_camchain, "equidistant")
    path = tmp_path / "left.yaml"
    path.write_text(yaml.safe_dump(camera_info(rig, "left", True)))
    with pytest.raises(InputError, match="put the other beside it"):
        read_calibration(path)
