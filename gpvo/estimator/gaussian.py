"""Quadratic costs: their minimum, covariances, and what remains when variables are left out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from factors.kernels.se3 import kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SMALLEST_PIVOT = 1e-7
"""Pivots below this, of a unit diagonal, are made of rounding errors."""


class IndeterminateError(ArithmeticError):
    """The cost does not determine all variables; `column` is the first that it leaves open."""

    def __init__(self, column: int) -> None:
        super().__init__(f"column {column} is not determined")
        self.column = column


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The cost d^T H d + 2 g^T d + c of D variables.

    Attributes
    ----------
    H, g, c
        (D, D) information matrix, (D,) half of the gradient at d = 0, and the cost there. Only the
        upper triangle of H is read, but by `cost`.
    """

    H: Array
    g: Array
    c: float = 0.0

    def cost(self, d: Array) -> float:
        """The cost of variables (D,)."""
        return float(d @ (self.H @ d + 2 * self.g)) + self.c

    def minimum(self) -> Array:
        """(D,) variables of least cost.

        Raises
        ------
        IndeterminateError
            If the information is singular or not finite.
        """
        lower, scale = self._factor
        solved, _ = lapack.dpotrs(lower, -scale * self.g, lower=1)
        return scale * solved

    def covariance(self, columns: Index) -> Array:
        """(n, n) covariance of some of the variables; raises as `minimum` does."""
        selection = np.zeros((len(self.g), len(columns)), order="F")
        selection[columns, np.arange(len(columns))] = 1.0
        root = self.root(selection)
        return root.T @ root

    def root(self, combinations: Array) -> Array:
        """(D, n) matrix M so that MᵀM is the covariance of linear combinations (D, n)."""
        if len(self.g) == 0:  # LAPACK takes no empty matrices
            return np.empty(combinations.shape)
        lower, scale = self._factor
        scaled = np.multiply(combinations, scale[:, None], order="F")
        root, _ = lapack.dtrtrs(lower, scaled, lower=1, overwrite_b=1)
        return root

    def marginal(self, out: int) -> Quadratic:
        """The cost of the variables from `out` on, least over those before (Schur complement)."""
        leaving = Quadratic(self.H[:out, :out].copy(), self.g[:out])
        root = leaving.root(np.column_stack([self.H[:out, out:], self.g[:out]]))
        by_kept, by_g = root[:, :-1], root[:, -1]
        H = self.H[out:, out:] - by_kept.T @ by_kept
        mirror_kernel(H)
        g = self.g[out:] - by_kept.T @ by_g
        return Quadratic(H, g, self.c - float(by_g @ by_g))

    @cached_property
    def _factor(self) -> tuple[Array, Array]:
        """Cholesky factor (D, D), lower, of H scaled to a unit diagonal, and the scale (D,).

        The scale makes the factor as accurate as the information's best scaling allows, however
        unequal radians, metres and seconds are (van der Sluis, 1969).
        """
        diagonal = np.diagonal(self.H)
        wrong = ~(np.isfinite(diagonal) & (diagonal > 0))
        if wrong.any():
            raise IndeterminateError(int(np.argmax(wrong)))
        scale = 1 / np.sqrt(diagonal)
        # The upper triangle of rows is the lower one of LAPACK's columns.
        lower, info = lapack.dpotrf(scaled_kernel(self.H, scale).T, lower=1, clean=0, overwrite_a=1)
        if info > 0:
            raise IndeterminateError(info - 1)
        small = ~(np.diagonal(lower) > SMALLEST_PIVOT)
        if small.any():
            raise IndeterminateError(int(np.argmax(small)))
        return lower, scale


@kernel
def scaled_kernel(H: Array, scale: Array) -> Array:
    """Upper triangle of H (D, D), rows and columns scaled."""
    result = np.empty(H.shape)
    for i in range(len(H)):
        for j in range(i, len(H)):
            result[i, j] = scale[i] * H[i, j] * scale[j]
    return result


@kernel
def mirror_kernel(H: Array) -> None:
    """Copy the upper triangle to the lower one."""
    for i in range(len(H)):
        for j in range(i):
            H[i, j] = H[j, i]
