"""Kernels of plain matrices of any size, inside numba code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import bare_kernel, inner_kernel

Array = NDArray[np.float64]


@inner_kernel
def product_kernel(A: Array, B: Array) -> Array:
    """Multiply two matrices."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                C[i, j] += A[i, k] * B[k, j]
    return C


@bare_kernel
def copy_columns_kernel(A: Array, first: int, to: Array) -> None:
    """Copy the columns from `first` on to a matrix with the same number of rows."""
    for j in range(to.shape[1]):
        for i in range(to.shape[0]):
            to[i, j] = A[i, first + j]


@bare_kernel
def copy_vector_kernel(a: Array, to: Array) -> None:
    """Copy a vector to the first places of another; cheaper to compile than a slice assignment."""
    for i in range(len(a)):
        to[i] = a[i]


@bare_kernel
def copy_kernel(A: Array, to: Array) -> None:
    """Copy one matrix to another; cheaper to compile than a slice assignment."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            to[i, j] = A[i, j]
