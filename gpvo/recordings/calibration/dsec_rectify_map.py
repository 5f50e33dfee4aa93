"""Compare DSEC's rectify_map.h5 with the calibration."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.calibration.rig import Camera
from gpvo.recordings.hdf5 import H5Error, holds, open_hdf5

LARGEST_DIFFERENCE = 0.5
"""Median difference, pixels; a map of other cameras differs by several pixels."""


def check_rectify_map(path: Path, camera: Camera, K_rect: NDArray[np.float64]) -> None:
    """Raise InputError if a map beside the events does not match the calibration.

    The map itself is not needed: the same table is computed from the calibration.
    """
    if not path.is_file() or not h5py.is_hdf5(path):
        return
    with open_hdf5(path) as file:
        if not holds(file, "rectify_map"):
            return
        try:
            stored = np.asarray(file["rectify_map"][()], np.float64)
        except (*H5Error, TypeError) as error:
            raise InputError(f"{path}: rectify_map cannot be read; copy it again") from error
    computed = camera.rectification_table(K_rect)
    if stored.shape != computed.shape:
        raise InputError(
            f"{path}: rectify_map has shape {stored.shape}, the calibration's sensor"
            f" {computed.shape}; give this camera's calibration"
        )
    difference = float(np.nanmedian(np.linalg.norm(stored - computed, axis=2)))
    if not difference < LARGEST_DIFFERENCE:
        raise InputError(
            f"{path}: rectify_map differs from the calibration by {difference:.2f} pixels (median);"
            " give the calibration of this sequence"
        )
