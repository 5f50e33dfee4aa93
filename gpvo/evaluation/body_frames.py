"""Ground truths of other bodies than the camera: how they carry the left event camera.

DSEC's poses are the lidar's, TUM-VIE's and VECtor's those of a motion-capture body. The chain to
the camera stands in calibration files, which are looked for beside the poses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.calibration import StereoRig
from gpvo.errors import InputError
from gpvo.recordings.basalt import imu_to_left, imu_to_marker
from gpvo.recordings.calibration_fields import Fields, load_fields
from gpvo.recordings.dsec_calibration import lidar_to_left

Transform = NDArray[np.float64]

DSEC = ("cam_to_cam.yaml", "cam_to_lidar.yaml")
TUM_VIE = ("camera-calibration*.json", "mocap-imu-calibration*.json")
VECTOR = ("*joint_camera_extrinsic*.yaml", "camera_mocap_extrinsic*.yaml")
FOLDERS_ABOVE = 2


def body_to_left(poses: Path, rig: StereoRig | None) -> Transform | None:
    """T_body_left (4, 4) of the rectified left camera, or None without calibration files.

    Parameters
    ----------
    poses
        File of the ground truth, known by its name: estimates may lie beside it, too.
    rig
        For its rectification; DSEC's is in its own files.

    Raises
    ------
    InputError
        If calibration files are there but cannot be used.
    """
    if poses.name == "pose.bag" and (files := _beside(poses, DSEC)):
        return lidar_to_left(*_load(files))
    if poses.name == "mocap_data.txt" and (files := _beside(poses, TUM_VIE)):
        camera, mocap = _load(files)
        T_body_raw = np.linalg.inv(imu_to_marker(mocap)) @ imu_to_left(camera)
    elif poses.name.endswith(".gt.txt") and (files := _beside(poses, VECTOR)):
        T_body_raw = _vector_body_to_raw(*_load(files))
    else:
        return None
    if rig is None:
        raise InputError(
            f"{poses}: holds poses of a body; give the calibration (--calibration) that rectifies"
            " the left camera"
        )
    return T_body_raw @ raw_to_rectified(rig)


def raw_to_rectified(rig: StereoRig) -> Transform:
    """T_raw_rect (4, 4) of the left camera."""
    T_raw_rect = np.eye(4)
    T_raw_rect[:3, :3] = rig.left.R_rect.T
    return T_raw_rect


def _vector_body_to_raw(joint: Fields, mocap: Fields) -> Transform:
    """VECtor: cam0 is the left frame camera, cam2 the left event camera."""
    T_cam0_left = joint.mapping("cam2").transform("T_cam0_cam2")
    return np.linalg.inv(mocap.mapping("cam0").transform("T_cam_body")) @ T_cam0_left


def _load(files: list[Path]) -> tuple[Fields, Fields]:
    first, second = (load_fields(file, "the calibration of the dataset") for file in files)
    return first, second


def _beside(poses: Path, patterns: tuple[str, ...]) -> list[Path]:
    """One file for each pattern, in the folder of the poses or one above; empty if one lacks."""
    folder = poses.absolute().parent
    for place in (folder, *folder.parents[:FOLDERS_ABOVE]):
        for where in (place, *sorted(place.glob("*calibration"))):
            found = [sorted(where.glob(pattern)) for pattern in patterns]
            if all(len(files) == 1 for files in found):
                return [files[0] for files in found]
            if all(found):
                names = ", ".join(file.name for files in found for file in files)
                raise InputError(f"{where}: holds several calibrations ({names}); keep one set")
    return []
