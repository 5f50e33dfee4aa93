"""The linearised measurements of a window, their landmarks eliminated.

The columns are those of the variables u of the states at the measurements' times (`Bridge`), of the
variables s of the landmarks' prior (`LandmarkPrior`), of the window's states (12 each), and of the
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import bare_kernel, kernel
from factors.kernels.se3 import Array
from factors.kernels.triangular import (
    solve_transposed_kernel,
    solve_upper_kernel,
    upper_root_kernel,
)
from factors.structureless.bridge import Bridge
from factors.structureless.prior_kernels import add_prior_products_kernel
from factors.structureless.row_kernels import (
    add_products_kernel,
    add_square_kernel,
    solve_kernel,
    spread_rows_kernel,
    whiten_kernel,
)

Index = NDArray[np.int64]

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

    @cached_property
    def latent(self) -> Index:
        """First column of each bridge's variables, and the first column after all of them."""
        return 6 * np.cumsum([0, *(bridge.rank for bridge in self.bridges)])


class Eliminated(NamedTuple):
    """Landmarks given all else: the rows root (n, 3, 3) by themselves, and cross (n, 3, w) by that.

    The latter have the columns (w,) of all, the others are zero; known (n,) is 1 for those that the
    rows determine.
    """

    columns: Index
    root: Array
    cross: Array
    known: Array

    @property
    def flat(self) -> Array:
        """(3 n, w) rows of cross."""
        return self.cross.reshape(-1, len(self.columns))


@dataclass(frozen=True, eq=False)
class JointSystem:
    """Quadratic cost of states, shared variables and landmarks, after elimination of these.

    Attributes
    ----------
    information
        (D, D) of the columns above: JᵀJ less what the landmarks explain, with unit priors on u, s.
    scale
        (D,) diagonal before the landmarks were eliminated.
    landmarks
        In the order of their numbers.
    latent
        First columns of the bridges' variables, and of s.
    shared
        Number of the columns of u and s, which come first.
    """

    information: Array
    scale: Array
    landmarks: Eliminated
    latent: Index
    shared: int

    @staticmethod
    def of_rows(found: Rows, landmarks: int) -> JointSystem:
        """The system of some rows of a number of landmarks."""
        latent = found.latent
        shared = int(latent[-1]) + found.prior.shape[2] - 13
        size = shared + 12 * found.states + 1
        H = np.zeros((size, size))
        H.ravel()[: shared * size : size + 1] = 1.0
        seen = _measured(found, landmarks, shared, H)
        scale = np.diag(H).copy()
        whiten_kernel(seen.root, seen.cross, seen.known)
        H -= seen.flat.T @ seen.flat
        return JointSystem(H, scale, seen, latent, shared)

    @cached_property
    def shared_given_states(self) -> tuple[Array, Array]:
        """Root R (S, S), upper, of the information on u and s, and R⁻ᵀ H_(us),(x, error).

        Raises
        ------
        numpy.linalg.LinAlgError
            If they are not determined.
        """
        rows, S = upper_root_kernel(self.information, self.shared), self.shared
        if not np.isfinite(rows[-1:, S - 1 :]).all():
            raise np.linalg.LinAlgError("what the landmarks share is not determined")
        return np.ascontiguousarray(rows[:, :S]), np.ascontiguousarray(rows[:, S:])

    def shared_mean(self, moved: Array) -> Array:
        """Return u and s (S,), given the step (12 m,) of the states."""
        root, right = self.shared_given_states
        mean = -(right @ np.append(moved, 1.0))[:, None]
        solve_upper_kernel(root, mean)
        return mean[:, 0]

    def part_given_states(self, part: slice) -> tuple[Array, Array]:
        """Return the regression (n, 12 m) of some of u and s on the states, and their covariance.

        That is (n, n), given the states.
        """
        root, right = self.shared_given_states
        columns = np.eye(self.shared - part.start, part.stop - part.start)
        solve_transposed_kernel(np.ascontiguousarray(root[part.start :, part.start :]), columns)
        return -columns.T @ right[part.start :, :-1], columns.T @ columns

    def on_states(self) -> tuple[Array, Array]:
        """Information (12 m + 1, 12 m + 1) on the states and the error alone, and its scale."""
        _, explained = self.shared_given_states
        H = self.information[self.shared :, self.shared :] - explained.T @ explained
        return H, np.sqrt(self.scale[self.shared :])

    def landmark_steps(self, moved: Array) -> Array:
        """Return the steps (L, 3) of the landmarks, given the step (12 m,) of the states."""
        x = -np.concatenate([self.shared_mean(moved), moved, [1.0]])
        steps = (self.landmarks.flat @ x).reshape(-1, 3)
        solve_kernel(self.landmarks.root, self.landmarks.known, steps)
        return steps

    @property
    def known(self) -> NDArray[np.bool_]:
        """(L,) which landmarks are determined."""
        return self.landmarks.known > 0

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
        by_states = -right
        solve_upper_kernel(root, by_states)
        by_noise = by_landmark @ np.linalg.inv(self.landmarks.root[of])
        by_all = -by_noise @ self.landmarks.cross[of]
        by_shared = by_all[:, :, :S]
        on_states = by_all[:, :, S:-1] + by_shared @ by_states[:, :-1]
        for n, column in enumerate(first.tolist()):
            on_states[n, :, column : column + 24] += rows[n, :, :24]
        error = rows[:, :, 30] + by_all[:, :, -1] + by_shared @ by_states[:, -1]
        free = np.ascontiguousarray(by_shared.reshape(3 * len(of), S).T)
        solve_transposed_kernel(root, free)
        free = free.T.reshape(by_shared.shape)
        parts = (on_states @ covariance, on_states), (free, free), (by_noise, by_noise)
        spread = np.eye(3) + sum(a @ b.transpose(0, 2, 1) for a, b in parts)
        return error, np.asarray(spread, np.float64)


def _measured(found: Rows, landmarks: int, shared: int, H: Array) -> Eliminated:
    """Sum the landmarks' products with themselves and all columns, and add JᵀJ to H."""
    own, cross = np.zeros((landmarks, 3, 3)), np.zeros((landmarks, 3, len(H)))
    _add_measurements(found, shared, H, cross, own)
    _add_prior(found, int(found.latent[-1]), H, cross, own)
    return Eliminated(np.arange(len(H)), own, cross, np.empty(landmarks))


def _add_measurements(found: Rows, shared: int, H: Array, cross: Array, own: Array) -> None:
    """Add JᵀJ of all columns to H, of the landmarks' with the others to `cross`, and to `own`."""
    latent = found.latent.tolist()
    ends = np.searchsorted(found.interval, np.arange(found.states)).tolist()
    for i, bridge in enumerate(found.bridges):
        part = slice(ends[i], ends[i + 1])
        rows, columns = found.rows[part], (shared + 12.0 * i, float(latent[i]))
        J = spread_rows_kernel(rows, bridge.gains)
        flat = J.reshape(-1, J.shape[2])
        add_square_kernel(flat.T @ flat, *columns, H)
        products = found.of[part], *columns, rows, bridge.gains, found.by_landmark[part]
        add_products_kernel(*products, cross, own)


def _add_prior(found: Rows, first: int, H: Array, cross: Array, own: Array) -> None:
    """Add the same of the landmarks' prior: of columns from the first one on, and the error."""
    flat = found.prior.reshape(-1, found.prior.shape[2])
    columns = prior_columns(first, flat.shape[1])
    H[columns[:, None], columns] += flat.T @ flat
    products = found.prior_of, float(first), found.prior, found.prior_by_landmark
    add_prior_products_kernel(*products, cross, own)


def prior_columns(first: int, width: int) -> Index:
    """Return the columns (width,) of a prior's rows: from the first one on, and the error's."""
    return np.append(first + np.arange(width - 1), -1)


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
        # Cauchy-Schwarz: else a small pivot's rounding errors explain more than there are errors.
        least = rest[i, -1] ** 2 / max(rest[-1, -1], rest[i, i])
        rest[i, i] = max(rest[i, i], least)
        pivot = np.sqrt(rest[i, i])
        for j in range(i, size):
            rest[i, j] /= pivot
            R[i, column[j]] = rest[i, j] * scale[column[j]]
        above = rest[i, i + 1 :]
        for k in range(i + 1, size):
            value, line = rest[i, k], rest[k, i + 1 :]
            for j in range(len(line)):
                line[j] -= value * above[j]
    R[-1, -1] = scale[-1] * np.sqrt(max(rest[-1, -1], 0.0))
    return R


@bare_kernel
def _swap_kernel(matrix: Array, column: Index, i: int, j: int) -> None:
    """Swap rows and columns i and j."""
    column[i], column[j] = column[j], column[i]
    for k in range(len(matrix)):
        matrix[i, k], matrix[j, k] = matrix[j, k], matrix[i, k]
    for k in range(len(matrix)):
        matrix[k, i], matrix[k, j] = matrix[k, j], matrix[k, i]
