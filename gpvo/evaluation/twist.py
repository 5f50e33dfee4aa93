"""Logarithm of rigid transforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


def log(transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 6) twists, rotation first, of transforms (N, 4, 4)."""
    omega = Rotation.from_matrix(transforms[:, :3, :3]).as_rotvec()
    position = transforms[:, :3, 3]
    angle = np.linalg.norm(omega, axis=1)
    half = 0.5 * np.where(angle < 1e-4, 1.0, angle)
    series = 1.0 / 12.0 + angle**2 / 720.0
    factor = np.where(angle < 1e-4, series, (1.0 - half / np.tan(half)) / (4.0 * half**2))
    turned = np.cross(omega, position)
    velocity = position - 0.5 * turned + factor[:, None] * np.cross(omega, turned)
    return np.hstack([omega, velocity])
