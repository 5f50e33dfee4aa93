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
    """Landmarks of (n,) numbers given all else: the rows root (n, 3, 3) and cross (n, 3, w).

    The latter have the columns (w,) of all, the others are zero; known (n,) is 1 for those that the
    rows determine.
    """

    of: Index
    columns: Index
    root: Array
    cross: Array
    known: Array

    @property
    def flat(self) -> Array:
        """(3 n, w) rows of cross."""
        return self.cross.reshape(-1, len(self.columns))

    def only(self, keep: NDArray[np.bool_]) -> Eliminated:
        """Return those that are kept (n,)."""
        if keep.all():
            return self
        of, columns, *arrays = self
        return Eliminated(of[keep], columns, *(array[keep] for array in arrays))


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
        Those that are measured, and those that only the prior knows.
    latent
        First columns of the bridges' variables, and of s.
    shared
        Number of the columns of u and s, which come first.
    """

    information: Array
    scale: Array
    landmarks: tuple[Eliminated, Eliminated]
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
        H, measured = np.zeros((size, size)), np.zeros(landmarks, np.bool_)
        measured[found.of] = True
        H.ravel()[: shared * size : size + 1] = 1.0
        seen = _measured(found, measured, shared, H)
        scale = np.diag(H).copy()
        whiten_kernel(seen.root, seen.cross, seen.known)
        H -= seen.flat.T @ seen.flat
        return JointSystem(H, scale, (seen, _others(found, measured)), latent, shared)

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
        steps = np.empty((sum(len(some.of) for some in self.landmarks), 3))
        for some in self.landmarks:
            found = (some.flat @ x[some.columns]).reshape(-1, 3)
            solve_kernel(some.root, some.known, found)
            steps[some.of] = found
        return steps

    @property
    def known(self) -> NDArray[np.bool_]:
        """(L,) which landmarks are determined."""
        known = np.empty(sum(len(some.of) for some in self.landmarks), np.bool_)
        for some in self.landmarks:
            known[some.of] = some.known > 0
        return known

    def predicted(
        self, of: Index, first: Index, rows: Array, by_landmark: Array, covariance: Array
    ) -> tuple[Array, Array]:
        """Return expected errors (n, 3) and their covariances (n, 3, 3) of new measurements.

        Their rows (n, 3, 31) and (n, 3, 3) are those of `measurement_rows_kernel`, of the
        landmarks `of` and of states from their columns `first` on; `covariance` is that of the
        states.
        """
        S, count = self.shared, len(self.known)
        root, right = self.shared_given_states
        by_states = -right
        solve_upper_kernel(root, by_states)
        all_roots, all_cross = np.empty((count, 3, 3)), np.zeros((count, 3, len(self.scale)))
        for some in self.landmarks:
            all_roots[some.of] = some.root
            all_cross[some.of[:, None], :, some.columns] = some.cross.transpose(0, 2, 1)
        by_noise = by_landmark @ np.linalg.inv(all_roots[of])
        by_all = -by_noise @ all_cross[of]
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


def _measured(found: Rows, measured: NDArray[np.bool_], shared: int, H: Array) -> Eliminated:
    """Sum the measured landmarks' products with themselves and all columns, and add JᵀJ to H."""
    of, size = np.flatnonzero(measured), len(H)
    place, first = np.cumsum(measured) - 1, shared - found.prior.shape[2] + 13
    own, cross = np.zeros((len(of), 3, 3)), np.zeros((len(of), 3, size))
    _add_measurements(found, place, shared, H, cross, own)
    mine = measured[found.prior_of]
    _add_prior(found, mine, place[found.prior_of[mine]], first, H, cross, own)
    return Eliminated(of, np.arange(size), own, cross, np.empty(len(of)))


def _others(found: Rows, measured: NDArray[np.bool_]) -> Eliminated:
    """The landmarks that are not measured: their prior has columns of s, the first state, error."""
    of, width = np.flatnonzero(~measured), found.prior.shape[2]
    own, cross = np.zeros((len(of), 3, 3)), np.zeros((len(of), 3, width))
    theirs = ~measured[found.prior_of]
    place = (np.cumsum(~measured) - 1)[found.prior_of[theirs]]
    rows, by_landmark = found.prior[theirs], found.prior_by_landmark[theirs]
    add_prior_products_kernel(place, 0.0, rows, by_landmark, cross, own)
    known, first = np.empty(len(of)), int(found.latent[-1])
    whiten_kernel(own, cross, known)
    columns = np.append(first + np.arange(width - 1), -1)
    return Eliminated(of, columns, own, cross, known)


def _add_measurements(
    found: Rows, place: Index, shared: int, H: Array, cross: Array, own: Array
) -> None:
    """Add JᵀJ of all columns to H, of the landmarks' with the others to `cross`, and to `own`."""
    latent = found.latent.tolist()
    ends = np.searchsorted(found.interval, np.arange(found.states)).tolist()
    for i, bridge in enumerate(found.bridges):
        part = slice(ends[i], ends[i + 1])
        rows, columns = found.rows[part], (shared + 12.0 * i, float(latent[i]))
        J = spread_rows_kernel(rows, bridge.gains)
        flat = J.reshape(-1, J.shape[2])
        add_square_kernel(flat.T @ flat, *columns, H)
        products = place[found.of[part]], *columns, rows, bridge.gains, found.by_landmark[part]
        add_products_kernel(*products, cross, own)


def _add_prior(
    found: Rows,
    mine: NDArray[np.bool_],
    place: Index,
    first: int,
    H: Array,
    cross: Array,
    own: Array,
) -> None:
    """Add the same of the measured landmarks' prior: of columns from the first one on, and error.

    They are at their place in `cross` and `own`.
    """
    rows, by_landmark = found.prior[mine], found.prior_by_landmark[mine]
    flat = rows.reshape(-1, rows.shape[2])
    columns = np.append(first + np.arange(flat.shape[1] - 1), -1)
    H[columns[:, None], columns] += flat.T @ flat
    add_prior_products_kernel(place, float(first), rows, by_landmark, cross, own)


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
