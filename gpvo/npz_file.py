"""Arrays from .npz files, with the shapes that they should have."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError

Shape = tuple[int | str, ...]
"""Sizes of an array; those of one name are the same in all arrays of a file."""


def read_npz(
    path: Path | str, what: str, shapes: Mapping[str, Shape], optional: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """Read arrays of numbers by name; an `optional` one may be missing.

    Raises
    ------
    InputError
        If the file is missing, damaged or not `what` it should be.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            names = [name for name in shapes if name in file or name not in optional]
            arrays = {name: file[name] for name in names}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except Exception as error:  # NumPy raises many kinds: of zip, of zlib, of Python's tokens, ...
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: is not {what} ({reason})") from error
    sizes: dict[str, int] = {}
    for name, array in arrays.items():
        if not _fits(array, shapes[name], sizes):
            found = f"{name} is {array.dtype} of shape {array.shape}"
            expected = ", ".join(map(str, shapes[name]))
            raise InputError(f"{path}: is not {what} ({found} instead of numbers ({expected}))")
    return arrays


def _fits(array: NDArray[Any], shape: Shape, sizes: dict[str, int]) -> bool:
    """Return whether an array has a shape; sizes of names that are new are noted."""
    if array.dtype.kind not in "iuf" or array.ndim != len(shape):
        return False
    return all(
        size == (sizes.setdefault(known, size) if isinstance(known, str) else known)
        for size, known in zip(array.shape, shape, strict=True)
    )
