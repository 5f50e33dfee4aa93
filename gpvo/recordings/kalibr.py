"""Stereo calibration from a kalibr camchain, with or without MVSEC's rectification."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from gpvo.calibration import Camera, DistortionModel, StereoRig
from gpvo.errors import InputError

COEFFICIENTS: dict[DistortionModel, tuple[int, ...]] = {
    "equidistant": (4,),
    "radtan": (4, 5),
    "none": (0, 4, 5),
}
"""How many distortion coefficients each model may have."""

RECTIFICATION = ("rectification_matrix", "projection_matrix")
LARGEST_SIDE = 65535
"""Pixels are uint16."""


def read_kalibr(path: Path | str) -> StereoRig:
    """Read the stereo rig of cam0 (left) and cam1 (right).

    The rectification is that of the file (rectification_matrix and projection_matrix, as MVSEC
    adds them); a camchain without gets OpenCV's, from cam1's T_cn_cnm1 (left to right).

    Raises
    ------
    InputError
        If the file cannot be read, or a field is missing or has no sensible value.
    """
    camchain = _load(Path(path))
    left, right = camchain.mapping("cam0"), camchain.mapping("cam1")
    cameras = _camera(left), _camera(right)
    if any(name in camera.values for camera in (left, right) for name in RECTIFICATION):
        R_rect = left.rotation("rectification_matrix"), right.rotation("rectification_matrix")
        P = left.array("projection_matrix", (3, 4)), right.array("projection_matrix", (3, 4))
        source = "projection_matrix"
    else:
        R_rect, P = _rectify(*cameras, right)
        source = "T_cn_cnm1"
    rectified = [replace(camera, R_rect=R) for camera, R in zip(cameras, R_rect, strict=True)]
    return _rig(rectified[0], rectified[1], P, right, source)


@dataclass(frozen=True)
class _Mapping:
    """A mapping of the file, with the place of it for messages."""

    path: Path
    name: str
    values: dict[Any, Any]

    def fail(self, field: str, problem: str) -> NoReturn:
        place = f"{self.name}/{field}" if self.name else field
        raise InputError(f"{self.path}: {place} {problem}")

    def get(self, field: str) -> Any:
        if field not in self.values:
            self.fail(field, "is missing; give a kalibr camchain of both cameras")
        return self.values[field]

    def mapping(self, field: str) -> _Mapping:
        values = self.get(field)
        if not isinstance(values, dict):
            self.fail(field, "must hold the fields of one camera")
        return _Mapping(self.path, field, values)

    def array(self, field: str, *shapes: tuple[int, ...]) -> NDArray[np.float64]:
        """Finite numbers of one of the given shapes."""
        expected = " or ".join(" x ".join(map(str, shape)) for shape in shapes)
        values = self.get(field)
        try:
            numbers = np.array(values, np.float64)
        except (ValueError, TypeError, OverflowError):
            self.fail(field, f"must be {expected} numbers")
        if numbers.shape not in shapes:
            self.fail(field, f"must be {expected} numbers, it has shape {numbers.shape}")
        if not np.isfinite(numbers).all():
            self.fail(field, "holds a number that is not finite")
        return numbers

    def rotation(self, field: str) -> NDArray[np.float64]:
        R = self.array(field, (3, 3))
        self.check_rotation(field, R)
        return R

    def check_rotation(self, field: str, R: NDArray[np.float64]) -> None:
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0.0:
            self.fail(field, "is not a rotation: its rows must be orthonormal, right-handed")


def _load(path: Path) -> _Mapping:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such calibration file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not a readable text file; give a kalibr camchain") from error
    try:
        values = yaml.safe_load(text)
    except Exception as error:  # PyYAML lets many kinds through: of recursion, of odd tags, ...
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}: is not valid YAML{line}; give a kalibr camchain") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no cam0 and cam1; give a kalibr camchain")
    return _Mapping(path, "", values)


def _camera(fields: _Mapping) -> Camera:
    """One camera, not rectified yet."""
    if fields.get("camera_model") != "pinhole":
        fields.fail("camera_model", f"is {fields.values['camera_model']!r}; only pinhole is known")
    intrinsics = fields.array("intrinsics", (4,))
    if not (intrinsics[:2] > 0.0).all():
        fields.fail("intrinsics", "has a focal length that is not positive")
    model, distortion = _distortion(fields)
    return Camera(_resolution(fields), intrinsics, model, distortion, np.eye(3))


def _distortion(fields: _Mapping) -> tuple[DistortionModel, NDArray[np.float64]]:
    model = fields.get("distortion_model")
    if not isinstance(model, str) or model not in COEFFICIENTS:
        fields.fail("distortion_model", f"is {model!r}; known are {', '.join(COEFFICIENTS)}")
    if model == "none":
        return "none", np.zeros(4)
    shapes = [(count,) for count in COEFFICIENTS[model]]
    return model, fields.array("distortion_coeffs", *shapes)


def _resolution(fields: _Mapping) -> tuple[int, int]:
    width, height = fields.array("resolution", (2,))
    for size in (width, height):
        if not (1 <= size <= LARGEST_SIDE and size == int(size)):
            fields.fail("resolution", "must be width and height in whole pixels")
    return int(width), int(height)


Pair = tuple[NDArray[np.float64], NDArray[np.float64]]


def _rectify(left: Camera, right: Camera, fields: _Mapping) -> tuple[Pair, Pair]:
    """Rectifying rotations and projections of both cameras, with zero disparity at infinity."""
    T_right_left = fields.array("T_cn_cnm1", (4, 4))
    R, t = T_right_left[:3, :3].copy(), T_right_left[:3, 3:].copy()
    fields.check_rotation("T_cn_cnm1", R)
    if abs(t[1, 0]) > abs(t[0, 0]):
        fields.fail("T_cn_cnm1", "does not place the cameras side by side")
    if (left.distortion_model == "equidistant") != (right.distortion_model == "equidistant"):
        fields.fail("distortion_model", "must be that of cam0, or give rectification matrices")
    fisheye = left.distortion_model == "equidistant"
    rectify: Any = cv2.fisheye.stereoRectify if fisheye else cv2.stereoRectify
    R_left, R_right, P_left, P_right, *_ = rectify(
        *(left.K, left.distortion, right.K, right.distortion),
        *(left.resolution, R, t),
        flags=cv2.CALIB_ZERO_DISPARITY,
    )
    return (R_left, R_right), (P_left, P_right)


def _rig(left: Camera, right: Camera, P: Pair, fields: _Mapping, source: str) -> StereoRig:
    """Rig of two rectified cameras; `source` is the field that a fault comes from."""
    P_left, P_right = P
    f, cx, cy = (float(number) for number in (P_left[0, 0], P_left[0, 2], P_left[1, 2]))
    K_rect = np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])
    shared = np.allclose([P_left[:, :3], P_right[:, :3]], K_rect, rtol=0.0, atol=1e-3)
    if not (shared and f > 0.0):
        fields.fail(source, "does not give both cameras one focal length and principal point")
    if np.any(P_left[:, 3]) or abs(P_right[1, 3]) > 1e-6 * f:
        fields.fail(source, "does not place the cameras side by side")
    baseline = float(-P_right[0, 3] / f)
    if not 0.0 < baseline < np.inf:
        fields.fail(source, "gives no positive baseline; cam0 must be the left camera")
    return StereoRig(left, right, f, (cx, cy), baseline)
