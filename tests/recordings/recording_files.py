"""Contents of small MVSEC recordings and camchains, for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

WIDTH, HEIGHT = 64, 48


def camchain() -> dict[str, Any]:
    """Return a kalibr camchain of two fisheye cameras 0.1 m apart, without rectification."""
    camera = {
        "camera_model": "pinhole",
        "distortion_model": "equidistant",
        "distortion_coeffs": [-0.05, 0.01, -0.05, 0.02],
        "intrinsics": [42.0, 41.5, 32.3, 24.6],
        "resolution": [WIDTH, HEIGHT],
    }
    T_right_left = np.eye(4)
    T_right_left[:3, 3] = [-0.1, 0.0004, 0.0001]
    return {"cam0": dict(camera), "cam1": dict(camera) | {"T_cn_cnm1": T_right_left.tolist()}}


def event_rows(count: int, seed: int = 0, start: float = 1.5e9, seconds: float = 0.5) -> np.ndarray:
    """Return random rows (count, 4) of MVSEC: x, y, sorted times, polarity -1 or 1."""
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count)
    t = start + np.sort(rng.uniform(0.0, seconds, count))
    return np.stack([x, y, t, rng.choice([-1.0, 1.0], count)], axis=1)


def write_mvsec(path: Path, left: Any, right: Any, **options: Any) -> Path:
    """Write the tables of both cameras; None leaves a camera out."""
    with h5py.File(path, "w") as file:
        file.create_group("davis")
        for side, table in (("left", left), ("right", right)):
            if table is not None:
                file.create_dataset(f"davis/{side}/events", data=table, **options)
    return path
