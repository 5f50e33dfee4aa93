"""Positions at the full resolution and among larger pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def to_full_resolution(points: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Return the full-resolution position of pixels that are `side` full pixels wide."""
    return points * side + (side - 1) / 2


def from_full_resolution(points: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Return the position among pixels that are `side` full pixels wide."""
    return (points - (side - 1) / 2) / side
