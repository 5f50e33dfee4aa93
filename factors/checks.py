"""Checks of arguments, which raise a ValueError that names the wrong argument."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import index
from typing import Any, SupportsIndex, SupportsInt

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.kernels.compiled import kernel
from factors.kernels.se3 import Array

Pose = ArrayLike | gtsam.Pose3
"""A transform (4, 4), or GTSAM's."""
Poses = Pose | Sequence[gtsam.Pose3]
"""Transforms (..., 4, 4), or GTSAM's."""

_ORTHONORMAL = 1e-5
"""Largest error of RᵀR: much for rounding in single precision, little for an estimate."""
_ROUNDING = 1e-12
"""Largest error of the last row, which rounding leaves of a matrix exponential or logarithm."""


def checked_numbers(name: str, numbers: Any) -> Array:
    """Return a contiguous array of real numbers."""
    try:
        found = np.asarray(numbers)
    except ValueError:  # lists of different lengths
        found = np.empty(0, object)
    if found.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be real numbers, not {type(numbers).__name__}")
    return np.asarray(found, np.float64, order="C")


def checked_number(name: str, number: float) -> float:
    """Return a finite number."""
    found = checked_numbers(name, number)
    if found.ndim or not np.isfinite(found):
        raise ValueError(f"{name} must be a finite number, not {number}")
    return float(found)


def checked_key(name: str, key: int) -> int:
    """Return a key of GTSAM's, an integer."""
    try:
        found = index(key)
    except TypeError:
        raise ValueError(f"{name} must be a key, an integer, not {key!r}") from None
    if not 0 <= found < 2**64:
        raise ValueError(f"{name} must be a key from 0 to 2^64 - 1, not {key}")
    return found


def key_name(key: SupportsInt | SupportsIndex) -> str:
    """Return GTSAM's name of a key, or its number if that name is no text."""
    try:
        return gtsam.DefaultKeyFormatter(key)
    except UnicodeDecodeError:
        return str(key)


def key_names(keys: Iterable[int]) -> str:
    """Return the names of keys."""
    return " ".join(map(key_name, keys))


def checked_array(name: str, array: ArrayLike, element: tuple[int, ...]) -> Array:
    """Return a contiguous array of finite numbers whose last axes have the shape `element`."""
    checked = checked_numbers(name, array)
    batch = checked.ndim - len(element)
    if batch < 0 or checked.shape[batch:] != element:
        expected = ", ".join(["...", *map(str, element)])
        raise ValueError(f"{name} must have the shape ({expected}), not {checked.shape}")
    if not np.isfinite(checked).all():
        raise ValueError(f"{name} must be finite")
    return checked


def checked_vector(name: str, vector: ArrayLike, size: int) -> Array:
    """Return a vector of finite numbers, (size,), that its owner cannot change any more."""
    checked = checked_array(name, vector, (size,))
    if checked.ndim != 1:
        raise ValueError(f"{name} must have the shape ({size},), not {checked.shape}")
    return checked.copy()


def checked_poses(name: str, T: Poses) -> Array:
    """Return transforms (..., 4, 4), each a rotation and a translation."""
    if isinstance(T, gtsam.Pose3):
        return np.ascontiguousarray(T.matrix())
    if isinstance(T, list | tuple) and len(T) and isinstance(T[0], gtsam.Pose3):
        T = [pose.matrix() for pose in T]
    transforms = checked_array(name, T, (4, 4))  # type: ignore[arg-type]
    if not _are_poses(transforms.reshape(-1, 4, 4)):
        raise ValueError(f"{name} must be poses [R t; 0 1] with a rotation R: RᵀR = 1, det R = 1")
    return transforms


def checked_pose(name: str, T: Pose) -> Array:
    """Return a transform (4, 4), a rotation and a translation, likewise its own."""
    transform = checked_poses(name, T)
    if transform.ndim != 2:
        raise ValueError(f"{name} must have the shape (4, 4), not {transform.shape}")
    return transform.copy()


@kernel
def _are_poses(T: Array) -> bool:
    """Tell whether all transforms (n, 4, 4) are rotations and translations."""
    for n in range(len(T)):
        R = T[n]
        for i in range(3):
            for j in range(3):
                product = R[0, i] * R[0, j] + R[1, i] * R[1, j] + R[2, i] * R[2, j]
                if not abs(product - (1.0 if i == j else 0.0)) < _ORTHONORMAL:
                    return False
        minor = R[1, 1] * R[2, 2] - R[1, 2] * R[2, 1]
        determinant = R[0, 0] * minor - R[1, 0] * (R[0, 1] * R[2, 2] - R[0, 2] * R[2, 1])
        determinant += R[2, 0] * (R[0, 1] * R[1, 2] - R[0, 2] * R[1, 1])
        if not determinant > 0:
            return False
        for j in range(4):
            if not abs(R[3, j] - (1.0 if j == 3 else 0.0)) < _ROUNDING:
                return False
    return True


def checked_duration(dt: float, name: str = "dt") -> float:
    """Return a finite and positive duration in seconds."""
    seconds = checked_number(name, dt)
    if seconds <= 0:
        raise ValueError(f"{name} must be positive seconds, not {dt}")
    return seconds


def power_spectral_density(qc: ArrayLike, n: int = 6) -> Array:
    """Return the matrix (n, n) of a power spectral density given as its diagonal (n,) or whole."""
    return checked_positive_definite("qc", qc, n)


def checked_positive_definite(name: str, given: ArrayLike, n: int) -> Array:
    """Return a matrix (n, n) that is given whole or as its diagonal (n,).

    Raises
    ------
    ValueError
        If the shape is another one, a number is not finite, or the matrix is not symmetric and
        positive definite.
    """
    array = checked_numbers(name, given)
    if not n or array.shape not in ((n,), (n, n)) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be {n} or {n} x {n} finite numbers, not {array}")
    if not _is_positive_definite(array):
        raise ValueError(f"{name} must be symmetric and positive definite, not {array}")
    return np.diag(array) if array.ndim == 1 else 0.5 * (array + array.T)


def checked_covariance(name: str, given: ArrayLike, n: int) -> Array:
    """Return a covariance (n, n): finite, symmetric, and positive semidefinite but for rounding."""
    matrix = checked_array(name, given, (n, n))
    is_symmetric = matrix.ndim == 2 and _is_symmetric(matrix, 1e-6)
    if not (is_symmetric and are_semidefinite(np.linalg.eigvalsh(matrix))):
        raise ValueError(f"{name} must be a covariance ({n}, {n}): positive semidefinite")
    return matrix


def _is_positive_definite(matrix: Array) -> bool:
    """Tell whether a matrix (n, n), or a diagonal (n,), is symmetric and positive definite.

    Symmetric but for rounding, next to the diagonal: that of A D Aᵀ, say.
    """
    if matrix.ndim == 1:
        return bool(matrix.min() > 0)
    return _is_symmetric(matrix, 1e-12) and bool(np.linalg.eigvalsh(matrix)[0] > 0)


def _is_symmetric(matrix: Array, rounding: float) -> bool:
    scale = np.sqrt(np.abs(np.diag(matrix)))
    return bool((np.abs(matrix - matrix.T) <= rounding * np.outer(scale, scale)).all())


def are_semidefinite(eigenvalues: NDArray[np.floating[Any]]) -> bool:
    """Tell whether matrices with these increasing eigenvalues (..., n) are so but for rounding."""
    return bool((eigenvalues[..., 0] >= -1e-8 * np.abs(eigenvalues[..., -1])).all())


def checked_noise(model: object, dimension: int) -> None:
    """Check that a noise model has the dimension of the measurement."""
    if not isinstance(model, gtsam.noiseModel.Base):
        raise ValueError(f"model must be a GTSAM noise model, not {type(model).__name__}")
    if model.dim() != dimension:
        raise ValueError(f"model must have the dimension {dimension}, not {model.dim()}")


def checked_finite_noise(model: object, dimension: int) -> None:
    """Check a noise model as `checked_noise` does, and that no variance is zero."""
    checked_noise(model, dimension)
    gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
    if isinstance(gaussian, gtsam.noiseModel.Constrained):
        raise ValueError("model must not be Constrained here: give small sigmas")
