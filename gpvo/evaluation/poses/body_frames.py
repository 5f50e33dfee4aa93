"""Transforms from the bodies of ground truths to the left event camera.

DSEC's poses are those of the lidar, TUM-VIE's and VECtor's those of a motion-capture body. Their
extrinsics are in calibration files, which are searched beside the recording and the poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings import StereoRig
from gpvo.recordings.calibration.basalt import imu_to_left, imu_to_marker
from gpvo.recordings.calibration.dsec import lidar_to_left
from gpvo.recordings.calibration.fields import Fields, load_fields

Transform = NDArray[np.float64]

DSEC = ("cam_to_cam.yaml", "cam_to_lidar.yaml")
TUM_VIE = ("camera-calibration*.json", "mocap-imu-calibration*.json")
VECTOR = ("*joint_camera_extrinsic*.yaml", "camera_mocap_extrinsic*.yaml")
FOLDERS_ABOVE = 2


def body_to_left(
    poses: Path, rig: StereoRig | None, beside: Sequence[Path] = ()
) -> Transform | None:
    """Find T_body_left (4, 4) of the rectified left camera; None without calibration files.

    Parameters
    ----------
    poses
        File of the ground truth. Its name identifies the data set, since estimates may be in the
        same folder.
    rig
        Cameras with the rectification; not needed for DSEC, whose own files have it.
    beside
        Paths to search before the folder of the poses: a calibration file, the recording.

    Raises
    ------
    InputError
        If calibration files are found that cannot be used.
    """
    places = [*beside, poses]
    if poses.name == "pose.bag" and (files := _find(places, DSEC)):
        return lidar_to_left(*_load(files))
    if poses.name == "mocap_data.txt" and (files := _find(places, TUM_VIE)):
        camera, mocap = _load(files)
        T_body_raw = np.linalg.inv(imu_to_marker(mocap)) @ imu_to_left(camera)
    elif poses.name.endswith(".gt.txt") and (files := _find(places, VECTOR)):
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
    """Return T_raw_rect (4, 4) of the left camera."""
    T_raw_rect = np.eye(4)
    T_raw_rect[:3, :3] = rig.left.R_rect.T
    return T_raw_rect


def _vector_body_to_raw(joint: Fields, mocap: Fields) -> Transform:
    """Compute T_body_raw of VECtor; cam0 is the left frame camera, cam2 the left event camera."""
    T_cam0_left = joint.mapping("cam2").transform("T_cam0_cam2")
    return np.linalg.inv(mocap.mapping("cam0").transform("T_cam_body")) @ T_cam0_left


def _load(files: list[Path]) -> tuple[Fields, Fields]:
    first, second = (load_fields(file, "the calibration of the dataset") for file in files)
    return first, second


def _find(places: list[Path], patterns: tuple[str, ...]) -> list[Path]:
    """Find one file for each pattern, in the nearest folder that has them; empty if none has."""
    for place in places:
        folder = place.absolute() if place.is_dir() else place.absolute().parent
        for near in (folder, *folder.parents[:FOLDERS_ABOVE]):
            if files := _in_folder(near, patterns):
                return files
    return []


def _in_folder(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    """Find one file for each pattern in a folder or its calibration folders; empty if not all."""
    found: list[list[Path]] = [[] for _ in patterns]
    for where in (folder, *sorted(folder.glob("*calibration"))):
        for files, pattern in zip(found, patterns, strict=True):
            files += sorted(where.glob(pattern))
    if not all(found):
        return []
    if any(len(files) > 1 for files in found):
        names = ", ".join(str(file.relative_to(folder)) for files in found for file in files)
        raise InputError(
            f"{folder}: holds several calibrations ({names}); give the right one with --calibration"
        )
    return [file for (file,) in found]
