"""Cholesky's factorisation of small matrices."""

from __future__ import annotations

import numpy as np

from factors.kernels.se3 import Array, inner_kernel


@inner_kernel
def factorize_kernel(A: Array) -> None:
    """Replace the lower triangle of a positive definite matrix by that of its root L, LLᵀ = A."""
    for i in range(len(A)):
        for j in range(i + 1):
            value = A[i, j]
            for k in range(j):
                value -= A[i, k] * A[j, k]
            A[i, j] = np.sqrt(value) if i == j else value / A[j, j]


@inner_kernel
def solve_lower_kernel(L: Array, B: Array) -> None:
    """Replace B by L⁻¹ B, of a lower triangular matrix."""
    for j in range(B.shape[1]):
        for i in range(len(L)):
            for k in range(i):
                B[i, j] -= L[i, k] * B[k, j]
            B[i, j] /= L[i, i]
