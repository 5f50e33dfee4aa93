"""The true surface of a simulated scene, in a file beside its ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.npz_file import read_npz

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
    arrays = read_npz(path, "a scene that a simulation wrote", {"boxes": ("B", 2, 3)})
    return np.asarray(arrays["boxes"], np.float64)


def scene_beside(result: Path, ground_truth: Path | None) -> Path | None:
    """Return the scene in a result folder or beside the ground truth, None if there is none."""
    places = [result / SCENE_FILE]
    if ground_truth is not None and ground_truth.name.endswith(TRUTH_ENDING):
        name = ground_truth.name.removesuffix(TRUTH_ENDING) + SCENE_ENDING
        places.append(ground_truth.with_name(name))
    return next((place for place in places if place.is_file()), None)
