"""Checks of arguments, which raise a ValueError that names the wrong argument."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from factors.kernels import Array


def checked_array(name: str, array: ArrayLike, element: tuple[int, ...]) -> Array:
    """Return a contiguous array of finite numbers whose last axes have the shape `element`."""
    checked = np.asarray(array, np.float64, order="C")
    batch = checked.ndim - len(element)
    if batch < 0 or checked.shape[batch:] != element:
        expected = ", ".join(["...", *map(str, element)])
        raise ValueError(f"{name} must have the shape ({expected}), not {checked.shape}")
    if not np.isfinite(checked).all():
        raise ValueError(f"{name} must be finite")
    return checked


def checked_vector(name: str, vector: ArrayLike, size: int) -> Array:
    """Return a vector of finite numbers, (size,)."""
    checked = checked_array(name, vector, (size,))
    if checked.ndim != 1:
        raise ValueError(f"{name} must have the shape ({size},), not {checked.shape}")
    return checked


def checked_duration(dt: float) -> float:
    """Return a finite and positive duration in seconds."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt must be positive seconds, not {dt}")
    return float(dt)


def power_spectral_density(qc: ArrayLike) -> Array:
    """Return the matrix (6, 6) of a power spectral density given as its diagonal (6,) or whole.

    Raises
    ------
    ValueError
        If the shape is another one, a number is not finite, or the matrix is not symmetric and
        positive definite.
    """
    array = np.asarray(qc, np.float64)
    if array.shape not in ((6,), (6, 6)) or not np.isfinite(array).all():
        raise ValueError(f"qc must be 6 or 6 x 6 finite numbers, not {array}")
    matrix = np.diag(array) if array.ndim == 1 else array
    if not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0):
        raise ValueError("qc must be symmetric")
    if np.linalg.eigvalsh(matrix)[0] <= 0:
        raise ValueError("qc must be positive definite")
    return matrix


def checked_noise(model: object, dimension: int) -> None:
    """Check that a noise model has the dimension of the measurement."""
    actual = getattr(model, "dim", None)
    if actual is None:
        raise ValueError(f"model must be a GTSAM noise model, not {type(model).__name__}")
    if actual() != dimension:
        raise ValueError(f"model must have the dimension {dimension}, not {actual()}")
