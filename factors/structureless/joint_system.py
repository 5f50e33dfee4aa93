"""The linearised measurements of a window, their landmarks eliminated.

The columns are those of the variables u of the states at the measurements' times (`Bridge`), of the
variables s of the landmarks' prior (`LandmarkPrior`), of the window's states (12 each), and of the
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from factors.kernels.se3 import Array, inner_kernel, kernel
from factors.structureless.bridge import Bridge
from factors.structureless.prior_kernels import add_prior_products_kernel
from factors.structureless.row_kernels import (
    add_cross_products_kernel,
    add_square_kernel,
    solve_kernel,
    spread_rows_kernel,
    whiten_kernel,
)

Index = NDArray[np.int64]

_BLOCK = 64  # rows that are solved at once: numpy does not know of triangles
_ROUNDING = 1e-12  # pivots below this, of a unit diagonal, are made of rounding errors


@dataclass(frozen=True, eq=False)
class Rows:
    """Whitened errors of measurements in order of the intervals between the states.

    Attributes
    ----------
    interval, of
        (n,) number of the state before each measurement, and its landmark.
    rows, by_landmark
        (n, 3, 31) and (n, 3, 3) of `measurement_rows_kernel`; the columns of xi are scaled by the
        root of Q_c.
    bridges
        One for each interval.
    prior, prior_by_landmark, prior_of
        (P, 3, d + 12 + 1) and (P, 3, 3) of `prior_system_kernel`, and (P,) landmarks of these.
    """

    interval: Index
    of: Index
    rows: Array
    by_landmark: Array
    bridges: list[Bridge]
    prior: Array
    prior_by_landmark: Array
    prior_of: Index

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.bridges) + 1

    @property
    def latent(self) -> Index:
        """First column of each bridge's variables, and the first column after all of them."""
        return 6 * np.cumsum([0, *(bridge.rank for bridge in self.bridges)])


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Quadratic cost of states, shared variables and landmarks, after elimination of these.

    Attributes
    ----------
    information
        (D, D) of the columns above: JᵀJ less what the landmarks explain, with unit priors on u, s.
    scale
        (D,) diagonal before the landmarks were eliminated.
    root, cross, known
        Landmarks given all else: the rows root (L, 3, 3) and cross (L, 3, D); known (L,) is 1 for
        those that the rows determine.
    latent
        First columns of the bridges' variables, and of s.
    shared
        Number of the columns of u and s, which come first.
    """

    information: Array
    scale: Array
    root: Array
    cross: Array
    known: Array
    latent: Index
    shared: int

    @staticmethod
    def of_rows(found: Rows, landmarks: int) -> JointSystem:
        """The system of some rows of a number of landmarks.

        Those that are not measured tell nothing of the states: whatever these are, the landmark
        fits its prior.
        """
        latent = found.latent
        shared = int(latent[-1]) + found.prior.shape[2] - 13
        size = shared + 12 * found.states + 1
        H, own = np.zeros((size, size)), np.zeros((landmarks, 3, 3))
        cross, measured = np.zeros((landmarks, 3, size)), np.zeros(landmarks, np.bool_)
        measured[found.of] = True
        _add_measurements(found, latent, shared, H, cross, own)
        if len(found.prior):
            _add_prior(found, measured, int(latent[-1]), H, cross, own)
        H.ravel()[: shared * size : size + 1] += 1.0
        scale, known = np.diag(H).copy(), np.empty(landmarks)
        whiten_kernel(own, cross, known)
        flat = cross[measured].reshape(-1, size)
        H -= flat.T @ flat if len(flat) else 0.0
        return JointSystem(H, scale, own, cross, known, latent, shared)

    @cached_property
    def shared_given_states(self) -> tuple[Array, Array]:
        """Root L (S, S), lower, of the information on u and s, and L⁻¹ H_(us),(x, error)."""
        H, S = self.information, self.shared
        root = np.asarray(np.linalg.cholesky(H[:S, :S]), np.float64)
        return root, solve_lower(root, H[:S, S:])

    def shared_mean(self, moved: Array) -> Array:
        """Return u and s (S,), given the step (12 m,) of the states."""
        root, right = self.shared_given_states
        return -solve_transposed(root, right @ np.append(moved, 1.0))

    def part_given_states(self, part: slice) -> tuple[Array, Array]:
        """Return the regression (n, 12 m) of some of u and s on the states, and their covariance.

        That is (n, n), given the states.
        """
        root, right = self.shared_given_states
        unit = np.eye(self.shared - part.start, part.stop - part.start)
        columns = solve_lower(root[part.start :, part.start :], unit)
        return -columns.T @ right[part.start :, :-1], columns.T @ columns

    def on_states(self) -> tuple[Array, Array]:
        """Information (12 m + 1, 12 m + 1) on the states and the error alone, and its scale."""
        _, explained = self.shared_given_states
        H = self.information[self.shared :, self.shared :] - explained.T @ explained
        return H, np.sqrt(self.scale[self.shared :])

    def landmark_steps(self, moved: Array) -> Array:
        """Return the steps (L, 3) of the landmarks, given the step (12 m,) of the states."""
        steps = self.cross @ -np.concatenate([self.shared_mean(moved), moved, [1.0]])
        solve_kernel(self.root, self.known, steps)
        return steps

    def predicted(
        self, of: Index, first: Index, rows: Array, by_landmark: Array, covariance: Array
    ) -> tuple[Array, Array]:
        """Return expected errors (n, 3) and their covariances (n, 3, 3) of new measurements.

        Their rows (n, 3, 31) and (n, 3, 3) are those of `measurement_rows_kernel`, of the
        landmarks `of` and of states from their columns `first` on; `covariance` is that of the
        states.
        """
        S = self.shared
        root, right = self.shared_given_states
        by_states = -solve_transposed(root, right)
        by_noise = by_landmark @ np.linalg.inv(self.root[of])
        by_all = -by_noise @ self.cross[of]
        by_shared = by_all[:, :, :S]
        on_states = by_all[:, :, S:-1] + by_shared @ by_states[:, :-1]
        for n, column in enumerate(first.tolist()):
            on_states[n, :, column : column + 24] += rows[n, :, :24]
        error = rows[:, :, 30] + by_all[:, :, -1] + by_shared @ by_states[:, -1]
        flat = by_shared.reshape(3 * len(of), S)
        free = solve_lower(root, flat.T).T.reshape(by_shared.shape)
        parts = (on_states @ covariance, on_states), (free, free), (by_noise, by_noise)
        spread = np.eye(3) + sum(a @ b.transpose(0, 2, 1) for a, b in parts)
        return error, np.asarray(spread, np.float64)


def solve_lower(root: Array, right: Array) -> Array:
    """X, root X = right, of a lower triangular matrix (S, S); block by block."""
    X = right.copy()
    for i in range(0, len(root), _BLOCK):
        block = slice(i, i + _BLOCK)
        X[block] -= root[block, :i] @ X[:i]
        X[block] = np.linalg.solve(root[block, block], X[block])
    return X


def solve_transposed(root: Array, right: Array) -> Array:
    """X, rootᵀ X = right, of a lower triangular matrix (S, S); block by block."""
    X = right.copy()
    for i in reversed(range(0, len(root), _BLOCK)):
        block, later = slice(i, i + _BLOCK), slice(i + _BLOCK, None)
        X[block] -= root[later, block].T @ X[later]
        X[block] = np.linalg.solve(root[block, block].T, X[block])
    return X


def _add_measurements(
    found: Rows, latent: Index, shared: int, H: Array, cross: Array, own: Array
) -> None:
    """Add JᵀJ of all columns to H, of the landmarks' with the others to `cross`, and to `own`."""
    interval, rank = found.interval, np.array([bridge.rank for bridge in found.bridges])
    gains = np.zeros((len(interval), int(rank.max())))
    ends = np.searchsorted(interval, np.arange(found.states)).tolist()
    for i, bridge in enumerate(found.bridges):
        gains[ends[i] : ends[i + 1], : bridge.rank] = bridge.gains
    J = spread_rows_kernel(found.rows, rank[interval], gains)
    for i, bridge in enumerate(found.bridges):
        flat = J[ends[i] : ends[i + 1]].reshape(-1, J.shape[2])
        columns = shared + 12.0 * i, float(latent[i]), float(bridge.rank)
        add_square_kernel(flat.T @ flat, *columns, H)
    places = shared + 12 * interval, latent[interval], rank[interval]
    add_cross_products_kernel(found.of, *places, J, found.by_landmark, cross, own)


def _add_prior(
    found: Rows, measured: NDArray[np.bool_], first: int, H: Array, cross: Array, own: Array
) -> None:
    """Add the same of the landmarks' prior: of columns from the first one on, and of the error.

    To H only of the measured landmarks.
    """
    flat = found.prior[measured[found.prior_of]].reshape(-1, found.prior.shape[2])
    square, columns = flat.T @ flat, slice(first, first + flat.shape[1] - 1)
    H[columns, columns] += square[:-1, :-1]
    H[columns, -1] += square[:-1, -1]
    H[-1, columns] += square[-1, :-1]
    H[-1, -1] += square[-1, -1]
    of, by_landmark = found.prior_of, found.prior_by_landmark
    add_prior_products_kernel(of, float(first), found.prior, by_landmark, cross, own)


@kernel
def root_kernel(H: Array, scale: Array) -> Array:
    """R (D, D), RᵀR = H, of a symmetric matrix H, which may be singular.

    Cholesky with pivoting, in units of the scale (D,): what is left in the end is rounding errors,
    which without pivoting grow from row to row. The last column, of the errors, stays the last.
    """
    size = len(H)
    R, rest, column = np.zeros(H.shape), np.zeros(H.shape), np.arange(size)
    for i in range(size):
        for j in range(i, size):
            unit = scale[i] * scale[j]
            rest[i, j] = rest[j, i] = H[i, j] / unit if unit > 0 else 0.0
    for i in range(size - 1):
        best = i
        for k in range(i + 1, size - 1):
            if rest[k, k] > rest[best, best]:
                best = k
        if not rest[best, best] > _ROUNDING:
            break
        _swap_kernel(rest, column, i, best)
        pivot = np.sqrt(rest[i, i])
        for j in range(i, size):
            rest[i, j] /= pivot
            R[i, column[j]] = rest[i, j] * scale[column[j]]
        for k in range(i + 1, size):
            value = rest[i, k]
            for j in range(i + 1, size):
                rest[k, j] -= value * rest[i, j]
    R[-1, -1] = scale[-1] * np.sqrt(max(rest[-1, -1], 0.0))
    return R


@inner_kernel
def _swap_kernel(matrix: Array, column: Index, i: int, j: int) -> None:
    """Swap rows and columns i and j."""
    column[i], column[j] = column[j], column[i]
    for k in range(len(matrix)):
        matrix[i, k], matrix[j, k] = matrix[j, k], matrix[i, k]
    for k in range(len(matrix)):
        matrix[k, i], matrix[k, j] = matrix[k, j], matrix[k, i]
