"""Checked fields of calibration files; every error message names the file and the place."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import yaml
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.calibration.rig import Camera, DistortionModel

COEFFICIENTS: dict[DistortionModel, tuple[int, ...]] = {
    "equidistant": (4,),
    "radtan": (4, 5),
    "none": (0, 4, 5),
}
"""Numbers of distortion coefficients that each model may have."""

LARGEST_SIDE = 65535
"""Pixels; columns and rows are uint16."""

SHORTEST_FOCAL, LONGEST_FOCAL = 0.05, 1000.0
"""Focal lengths of lenses, in sides of the picture: that of a fisheye is 0.2, of telescopes 100."""

OUTSIDE = 1.0
"""How far outside a picture the principal point may be, in sides: sensors may be read in part."""


@dataclass(frozen=True)
class Fields:
    """A mapping of the file, with its place for error messages."""

    path: Path
    name: str
    values: dict[Any, Any]
    expected: str = "a kalibr camchain"

    def fail(self, field: Any, problem: str) -> NoReturn:
        """Raise InputError about a field."""
        place = f"{self.name}/{field}" if self.name else field
        raise InputError(f"{self.path}: {place} {problem}")

    def get(self, field: Any) -> Any:
        """Return the value of a required field."""
        if field not in self.values:
            self.fail(field, f"is missing; give {self.expected} of both cameras")
        return self.values[field]

    def mapping(self, field: str) -> Fields:
        """Return the fields inside a field."""
        values = self.get(field)
        if not isinstance(values, dict):
            self.fail(field, "must hold the fields of one camera")
        name = f"{self.name}/{field}" if self.name else field
        return Fields(self.path, name, values, self.expected)

    def array(self, field: Any, *shapes: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the finite numbers of a field, of one of the given shapes."""
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
        """Return a rotation (3, 3)."""
        R = self.array(field, (3, 3))
        self.check_rotation(field, R)
        return R

    def transform(self, field: str) -> NDArray[np.float64]:
        """Return a rigid transform (4, 4)."""
        T = self.array(field, (4, 4))
        self.check_rotation(field, T[:3, :3])
        return T

    def check_rotation(self, field: str, R: NDArray[np.float64]) -> None:
        """Raise InputError unless R is orthonormal and right-handed."""
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0.0:
            self.fail(field, "is not a rotation: its rows must be orthonormal, right-handed")

    def intrinsics(self, field: str) -> NDArray[np.float64]:
        """Return fx, fy, cx, cy in pixels."""
        return self.array(field, (4,))

    def resolution(self, field: Any) -> tuple[int, int]:
        """Return width and height in pixels."""
        width, height = self.array(field, (2,))
        for size in (width, height):
            if not (1 <= size <= LARGEST_SIDE and size == int(size)):
                self.fail(field, "must be width and height in whole pixels")
        return int(width), int(height)

    def check_lens(
        self, field: Any, intrinsics: NDArray[np.float64], resolution: tuple[int, int]
    ) -> None:
        """Raise InputError unless focal lengths and principal point fit the resolution."""
        size = f"for {resolution[0]} x {resolution[1]} pixels; give it in pixels"
        focal = intrinsics[:2] / max(resolution)
        if not ((focal >= SHORTEST_FOCAL) & (focal <= LONGEST_FOCAL)).all():
            self.fail(field, f"has the focal length {intrinsics[0]:g}, {intrinsics[1]:g} {size}")
        if (np.abs(intrinsics[2:] / resolution - 0.5) > 0.5 + OUTSIDE).any():
            self.fail(field, f"has the principal point {intrinsics[2]:g}, {intrinsics[3]:g} {size}")

    def distortion(self) -> tuple[DistortionModel, NDArray[np.float64]]:
        """Return distortion_model and distortion_coeffs, named as in kalibr."""
        model = self.get("distortion_model")
        if not isinstance(model, str) or model not in COEFFICIENTS:
            self.fail("distortion_model", f"is {model!r}; known are {', '.join(COEFFICIENTS)}")
        if model == "none":
            return "none", np.zeros(4)
        shapes = [(count,) for count in COEFFICIENTS[model]]
        return model, self.array("distortion_coeffs", *shapes)

    def camera(self, intrinsics: str = "intrinsics") -> Camera:
        """Return one camera, not rectified yet, from fields named as in kalibr."""
        K = self.intrinsics(intrinsics)
        model, distortion = self.distortion()
        resolution = self.resolution("resolution")
        self.check_lens(intrinsics, K, resolution)
        return Camera(resolution, K, model, distortion, np.eye(3))


def load_fields(path: Path, expected: str = "a kalibr camchain") -> Fields:
    """Read a YAML (or OpenCV YAML) or JSON file.

    Raises
    ------
    InputError
        If it cannot be read or is no mapping.
    """
    text = _text(path, expected)
    kind = "JSON" if path.suffix == ".json" else "YAML"
    try:
        values = json.loads(text) if kind == "JSON" else yaml.safe_load(_plain_yaml(text))
    except Exception as error:  # PyYAML raises many kinds: for deep recursion, unknown tags, ...
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}: is not valid {kind}{line}; give {expected}") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no cam0 and cam1; give {expected}")
    return Fields(path, "", values, expected)


def _text(path: Path, expected: str) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such calibration file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not a readable text file; give {expected}") from error


def _plain_yaml(text: str) -> str:
    """Return the YAML without OpenCV's first line and without its tags of matrices."""
    if text.startswith("%YAML:"):
        text = text.partition("\n")[2]
    return re.sub("!!opencv-(nd-)?matrix", "", text)
