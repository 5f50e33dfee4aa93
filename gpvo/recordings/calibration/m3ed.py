"""Read M3ED's calibration, which is part of its HDF5 files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from gpvo.recordings.calibration.fields import Fields
from gpvo.recordings.calibration.rectification import rectified_rig
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.hdf5 import H5Error, holds, open_hdf5

NAMES = (
    "camera_model",
    "distortion_model",
    "distortion_coeffs",
    "intrinsics",
    "resolution",
    "T_to_prophesee_left",
)
EXPECTED = "a kalibr camchain, or an HDF5 file of M3ED with the calibration"


def read_m3ed(path: Path) -> StereoRig:
    """Read the rig of prophesee/left and prophesee/right of an M3ED file."""
    with open_hdf5(path) as file:
        left, right = (_fields(file, f"prophesee/{side}/calib") for side in ("left", "right"))
    T_left_right = right.transform("T_to_prophesee_left")
    T_right_left = np.asarray(np.linalg.inv(T_left_right), np.float64)
    return rectified_rig(left.camera(), right.camera(), T_right_left, right, "T_to_prophesee_left")


def _fields(file: h5py.File, group: str) -> Fields:
    """Return the datasets of a camera's calibration as fields."""
    path = Path(file.filename)
    values = {
        name: _value(file[f"{group}/{name}"]) for name in NAMES if holds(file, f"{group}/{name}")
    }
    return Fields(path, group, values, EXPECTED)


def _value(dataset: Any) -> Any:
    try:
        value = dataset[()]
    except (*H5Error, TypeError):
        return None
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return value.tolist() if isinstance(value, np.ndarray) else value
