"""Read the stereo rig of a kalibr camchain, with or without MVSEC's rectification."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpvo.recordings.calibration.fields import Fields, load_fields
from gpvo.recordings.calibration.rectification import projected_rig, rectified_rig
from gpvo.recordings.calibration.rig import Camera, StereoRig

DIFFERENT = 0.1
"""Difference between two statements of the baseline that is a contradiction, relative."""
RECTIFICATION = ("rectification_matrix", "projection_matrix")


def read_kalibr(path: Path | str) -> StereoRig:
    """Read the stereo rig of cam0 (left) and cam1 (right).

    The rectification is that of the file (rectification_matrix and projection_matrix, as MVSEC
    adds them). Without them it is OpenCV's, from cam1's T_cn_cnm1 (left to right).

    Raises
    ------
    InputError
        If the file cannot be read, or a field is missing or has no sensible value.
    """
    return kalibr_rig(load_fields(Path(path)))


def kalibr_rig(camchain: Fields) -> StereoRig:
    """Return the rig of a camchain's fields."""
    left, right = camchain.mapping("cam0"), camchain.mapping("cam1")
    cameras = _camera(left), _camera(right)
    if any(name in camera.values for camera in (left, right) for name in RECTIFICATION):
        R_rect = left.rotation("rectification_matrix"), right.rotation("rectification_matrix")
        P = left.array("projection_matrix", (3, 4)), right.array("projection_matrix", (3, 4))
        rig = projected_rig(*cameras, R_rect, P, right, "projection_matrix")
        if "T_cn_cnm1" in right.values:
            _check_extrinsics(right, rig)
        return rig
    return rectified_rig(*cameras, right.array("T_cn_cnm1", (4, 4)), right, "T_cn_cnm1")


def _check_extrinsics(right: Fields, rig: StereoRig) -> None:
    """Raise InputError if T_cn_cnm1 places the right camera elsewhere than the projections do."""
    T_right_left = right.array("T_cn_cnm1", (4, 4))
    t_left_right = -T_right_left[:3, :3].T @ T_right_left[:3, 3]
    baseline = rig.left.R_rect @ t_left_right
    if np.linalg.norm(baseline - [rig.baseline, 0.0, 0.0]) > DIFFERENT * rig.baseline:
        right.fail(
            "T_cn_cnm1",
            f"contradicts projection_matrix: it places the right camera at {baseline.round(4)} m in"
            f" the rectified left one, the projections at {rig.baseline:.4f} m to the right; is it"
            " the inverse, or of another calibration?",
        )


def _camera(fields: Fields) -> Camera:
    """Return one camera, not rectified yet."""
    if fields.get("camera_model") != "pinhole":
        fields.fail("camera_model", f"is {fields.values['camera_model']!r}; only pinhole is known")
    return fields.camera()
