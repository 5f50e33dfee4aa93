"""Quadratic costs: their minimum, covariances, and what remains when variables are left out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

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
        (D, D) information matrix, (D,) half of the gradient at d = 0, and the cost there.
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
        lower, scale = self._factor
        root, _ = lapack.dtrtrs(lower, scale[:, None] * combinations, lower=1)
        return root

    def marginal(self, kept: Index) -> Quadratic:
        """The cost of the kept variables (n,), least over the other ones (Schur complement)."""
        left = np.ones(len(self.g), bool)
        left[kept] = False
        out = np.flatnonzero(left)
        if len(out) == 0:
            return Quadratic(self.H[np.ix_(kept, kept)], self.g[kept], self.c)
        leaving = Quadratic(self.H[np.ix_(out, out)], self.g[out])
        root = leaving.root(np.column_stack([self.H[np.ix_(out, kept)], self.g[out]]))
        by_kept, by_g = root[:, :-1], root[:, -1]
        H = self.H[np.ix_(kept, kept)] - by_kept.T @ by_kept
        g = self.g[kept] - by_kept.T @ by_g
        return Quadratic(0.5 * (H + H.T), g, self.c - float(by_g @ by_g))

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
        scaled = self.H * scale
        scaled *= scale[:, None]
        # The transpose of a symmetric matrix is itself, in the order of LAPACK.
        lower, info = lapack.dpotrf(scaled.T, lower=1, overwrite_a=1)
        if info > 0:
            raise IndeterminateError(info - 1)
        small = ~(np.diagonal(lower) > SMALLEST_PIVOT)
        if small.any():
            raise IndeterminateError(int(np.argmax(small)))
        return lower, scale
