"""Read pairs of ROS CameraInfo: YAML files as written by camera_calibration and ESVO."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.calibration.fields import LARGEST_SIDE, Fields, load_fields
from gpvo.recordings.calibration.rectification import projected_rig, rectified_rig
from gpvo.recordings.calibration.rig import Camera, DistortionModel, StereoRig
from gpvo.recordings.pairing import paired_files

EXPECTED = "a ROS CameraInfo (YAML)"
MODELS: dict[str, DistortionModel] = {
    "plumb_bob": "radtan",
    "radtan": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "none": "none",
    "": "none",
}
COUNTS: dict[DistortionModel, tuple[int, ...]] = {
    "radtan": (4, 5),
    "equidistant": (4, 5),
    "none": (0, 4, 5),
}
VECTOR_JOINT = "*joint_camera_extrinsic*.yaml"


def is_camera_info(fields: Fields) -> bool:
    """Return whether a file looks like a CameraInfo."""
    return "camera_matrix" in fields.values and "image_width" in fields.values


def read_camera_info_pair(path: Path) -> StereoRig:
    """Read the rig of two CameraInfo files, given one of them.

    The transform between the cameras comes from the projection matrices, from T_right_left of
    either file (ESVO), or from VECtor's calibration of all cameras, which lies beside them.
    """
    both = paired_files(path)
    if both is None:
        raise InputError(
            f"{path}: is the calibration of one camera; put the other beside it, with left and"
            " right in the names"
        )
    left, right = (load_fields(file, EXPECTED) for file in both)
    joint = sorted(path.parent.glob(VECTOR_JOINT))
    if len(joint) == 1 and "T_right_left" not in right.values:
        right.values["T_right_left"] = _vector_transform(load_fields(joint[0], EXPECTED))
    return camera_info_rig(left, right)


def _vector_transform(joint: Fields) -> list[float]:
    """Return the first three rows of T_right_left; VECtor's event cameras are cam2 and cam3."""
    T_cam0_left = joint.mapping("cam2").transform("T_cam0_cam2")
    T_cam0_right = joint.mapping("cam3").transform("T_cam0_cam3")
    return (np.linalg.inv(T_cam0_right) @ T_cam0_left)[:3].ravel().tolist()


def camera_info_rig(left: Fields, right: Fields) -> StereoRig:
    """Return the rig of two CameraInfo."""
    cameras = _camera(left), _camera(right)
    if is_rectified_pair(left, right):
        R_rect = _matrix(left, "rectification_matrix", 3), _matrix(right, "rectification_matrix", 3)
        for fields, R in zip((left, right), R_rect, strict=True):
            fields.check_rotation("rectification_matrix", R)
        P = _matrix(left, "projection_matrix", 4), _matrix(right, "projection_matrix", 4)
        return projected_rig(*cameras, R_rect, P, right, "projection_matrix")
    source = right if "T_right_left" in right.values else left
    if "T_right_left" not in source.values:
        right.fail(
            "T_right_left",
            "is missing, and projection_matrix gives no baseline; calibrate the stereo pair",
        )
    T_right_left = np.eye(4)
    T_right_left[:3] = _matrix(source, "T_right_left", 4)
    return rectified_rig(*cameras, T_right_left, source, "T_right_left")


def is_rectified_pair(left: Fields, right: Fields) -> bool:
    """Return whether both cameras have a rectification and a baseline.

    Without them, drivers write zeros, and calibrations of single cameras the identity.
    """
    names = ("rectification_matrix", "projection_matrix")
    if any(name not in fields.values for name in names for fields in (left, right)):
        return False
    P_right = _matrix(right, "projection_matrix", 4)
    return bool(np.any(_matrix(left, "rectification_matrix", 3))) and bool(P_right[0, 3])


def _camera(fields: Fields) -> Camera:
    name = fields.get("distortion_model")
    if not isinstance(name, str) or name not in MODELS:
        fields.fail("distortion_model", f"is {name!r}; known are {', '.join(filter(None, MODELS))}")
    model = MODELS[name]
    # Only these four are read: one of ESVO's files has a damaged last row.
    numbers = _data(fields, "camera_matrix", (9,))
    intrinsics = numbers[[0, 4, 2, 5]]
    resolution = _resolution(fields)
    fields.check_lens("camera_matrix", intrinsics, resolution)
    return Camera(resolution, intrinsics, model, _distortion(fields, model), np.eye(3))


def _distortion(fields: Fields, model: DistortionModel) -> NDArray[np.float64]:
    if model == "none":
        return np.zeros(4)
    numbers = _data(fields, "distortion_coefficients", *((n,) for n in COUNTS[model]))
    return numbers[:4] if model == "equidistant" else numbers


def _resolution(fields: Fields) -> tuple[int, int]:
    size = [float(fields.array(name, ())) for name in ("image_width", "image_height")]
    for name, number in zip(("image_width", "image_height"), size, strict=True):
        if not (1 <= number <= LARGEST_SIDE and number == int(number)):
            fields.fail(name, "must be whole pixels")
    return int(size[0]), int(size[1])


def _matrix(fields: Fields, field: str, columns: int) -> NDArray[np.float64]:
    return _data(fields, field, (3 * columns,)).reshape(3, columns)


def _data(fields: Fields, field: str, *shapes: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the numbers in `data` of a matrix, or in a bare list."""
    value = fields.get(field)
    if isinstance(value, dict):
        return fields.mapping(field).array("data", *shapes)
    return fields.array(field, *shapes)
