"""The true surface of a simulated scene, in a file beside its ground truth."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError

Array = NDArray[np.float64]

SCENE_FILE = "scene.npz"
TRUTH_ENDING, SCENE_ENDING = "_gt.hdf5", "_scene.npz"


def write_scene(path: Path, boxes: Array) -> None:
    """Write the corners of boxes (B, 2, 3), the first seen from inside."""
    np.savez(path, allow_pickle=False, boxes=boxes)


def read_scene(path: Path) -> Array:
    """Read the corners of boxes (B, 2, 3).

    Raises
    ------
    InputError
        If the file is not a scene.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return np.asarray(file["boxes"], np.float64)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: is not a scene that a simulation wrote ({error})") from error


def scene_beside(result: Path, ground_truth: Path | None) -> Path | None:
    """Return the scene in a result folder or beside the ground truth, None if there is none."""
    places = [result / SCENE_FILE]
    if ground_truth is not None and ground_truth.name.endswith(TRUTH_ENDING):
        name = ground_truth.name.removesuffix(TRUTH_ENDING) + SCENE_ENDING
        places.append(ground_truth.with_name(name))
    return next((place for place in places if place.is_file()), None)
