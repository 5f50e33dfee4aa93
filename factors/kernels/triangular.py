"""Cholesky's factorisation of small matrices."""

from __future__ import annotations

import numpy as np

from factors.kernels.compiled import bare_kernel, kernel
from factors.kernels.matrices import copy_vector_kernel
from factors.kernels.se3 import Array


@bare_kernel
def factorize_kernel(A: Array) -> None:
    """Replace the lower triangle of a positive definite matrix by that of its root L, LLᵀ = A."""
    for i in range(len(A)):
        for j in range(i + 1):
            value = A[i, j]
            for k in range(j):
                value -= A[i, k] * A[j, k]
            A[i, j] = np.sqrt(value) if i == j else value / A[j, j]


@bare_kernel
def solve_lower_kernel(L: Array, B: Array) -> None:
    """Replace B by L⁻¹ B, of a lower triangular matrix."""
    for j in range(B.shape[1]):
        for i in range(len(L)):
            for k in range(i):
                B[i, j] -= L[i, k] * B[k, j]
            B[i, j] /= L[i, i]


@kernel
def upper_root_kernel(H: Array, count: int) -> Array:
    """First rows R (count, n) of the upper root of a symmetric matrix: RᵀR = H (n, n) in these.

    The rows are not a number from where H is not positive definite on. Four of those above a row
    are subtracted at a time: it is written to memory less often.
    """
    R = np.zeros((count, len(H)))
    for i in range(count):
        line, k = R[i, i:], 0
        copy_vector_kernel(H[i, i:], line)
        while k + 4 <= i:
            # Of slices it is known that all indices are within them: these loops are vectorised.
            a, b, c, d = R[k, i:], R[k + 1, i:], R[k + 2, i:], R[k + 3, i:]
            p, q, r, s = a[0], b[0], c[0], d[0]
            for j in range(len(line)):
                line[j] -= p * a[j] + q * b[j] + r * c[j] + s * d[j]
            k += 4
        for n in range(k, i):
            a = R[n, i:]
            p = a[0]
            for j in range(len(line)):
                line[j] -= p * a[j]
        scale = 1 / np.sqrt(line[0]) if line[0] > 0 else np.nan
        for j in range(len(line)):
            line[j] *= scale
    return R


@kernel
def solve_upper_kernel(R: Array, X: Array) -> None:
    """Replace X by R⁻¹ X, of an upper triangular matrix."""
    for i in range(len(R) - 1, -1, -1):
        for k in range(i + 1, len(R)):
            for j in range(X.shape[1]):
                X[i, j] -= R[i, k] * X[k, j]
        for j in range(X.shape[1]):
            X[i, j] /= R[i, i]


@kernel
def solve_transposed_kernel(R: Array, X: Array) -> None:
    """Replace X by R⁻ᵀ X, of an upper triangular matrix."""
    for i in range(len(R)):
        for j in range(X.shape[1]):
            X[i, j] /= R[i, i]
        for k in range(i + 1, len(R)):
            for j in range(X.shape[1]):
                X[k, j] -= R[i, k] * X[i, j]
