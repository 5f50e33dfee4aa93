"""The map as a table of landmarks, and its files."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.npz_file import Shape, read_npz

Array = NDArray[np.float64]

PLY_TYPE = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        *((name, "u1") for name in ("red", "green", "blue")),
        ("deviation", "<f4"),
        ("measurements", "<i4"),
        ("first_time", "<f8"),
        ("last_time", "<f8"),
    ]
)
PLY_NAMES = {"<f4": "float", "<f8": "double", "<i4": "int", "|u1": "uchar"}
SHAPES: dict[str, Shape] = {
    "landmark": ("N",),
    "position": ("N", 3),
    "covariance": ("N", 3, 3),
    "measurements": ("N",),
    "first_time": ("N",),
    "last_time": ("N",),
    "depth": ("N",),
}
"""Shapes of the arrays of a file."""
CERTAIN, UNCERTAIN = (0, 114, 178), (230, 159, 0)
"""RGB of the most and of the least certain landmarks."""


@dataclass(frozen=True, eq=False)
class LandmarkMap(ArrayTable):
    """N landmarks in the world of the trajectory.

    Attributes
    ----------
    landmark
        (N,) int64 identity.
    position
        (N, 3) metres.
    covariance
        (N, 3, 3) of the position given the trajectory, square metres.
    measurements
        (N,) int64 number of measurements.
    first_time, last_time
        (N,) seconds of the first and the last one.
    depth
        (N,) mean distance along the optical axis at its measurements, metres.
    """

    landmark: NDArray[np.int64]
    position: Array
    covariance: Array
    measurements: NDArray[np.int64]
    first_time: Array
    last_time: Array
    depth: Array

    @property
    def deviation(self) -> Array:
        """(N,) standard deviation of the position, the root of the covariance's trace, metres."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    def save(self, path: Path) -> None:
        """Write an .npz file."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        np.savez(path, allow_pickle=False, **columns)

    @staticmethod
    def load(path: Path) -> LandmarkMap:
        """Read a map that `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged or no map.
        """
        return LandmarkMap(**read_npz(path, "a map that `gpvo run` saved", SHAPES))

    def write_ply(self, path: Path) -> None:
        """Write a binary PLY file, coloured by certainty, blue to yellow."""
        rows = np.zeros(len(self), PLY_TYPE)
        for name, column in zip("xyz", self.position.T, strict=True):
            rows[name] = column
        for name, column in zip(("red", "green", "blue"), self.colours.T, strict=True):
            rows[name] = column
        for name in ("deviation", "measurements", "first_time", "last_time"):
            rows[name] = getattr(self, name)
        kinds = (PLY_TYPE.fields or {}).items()
        properties = [f"property {PLY_NAMES[kind[0].str]} {name}" for name, kind in kinds]
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(self)}"]
        text = "\n".join([*head, *properties, "end_header\n"])
        path.write_bytes(text.encode("ascii") + rows.tobytes())

    @property
    def colours(self) -> NDArray[np.uint8]:
        """RGB (N, 3) by the deviation relative to the depth, up to 5 %: blue to yellow."""
        share = np.clip(self.deviation / (0.05 * self.depth), 0, 1)[:, None]
        return np.rint((1 - share) * np.array(CERTAIN) + share * np.array(UNCERTAIN)).astype("u1")
