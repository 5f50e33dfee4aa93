"""States at every measurement's own time, eliminated in closed form.

Given the two key states around it, the local variables at a time between are Gaussian: about the
interpolated mean, with the covariance of a bridge. Measurements between the same two states see
these deviations, so that their errors are correlated; whitened together they tell of the key states
exactly what they would if each of their times had a state in the graph. Section III-C of the paper;
Barfoot, "State Estimation for Robotics", chapter 11.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from factors.kernels import kernel
from factors.local import (
    hermite_weights,
    interpolated_local_kernel,
    local_state_kernel,
    moved_kernel,
)
from gpvo.factor_graph import SAME_TIME
from gpvo.states import States, bracket

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Deviations:
    """How far states between key states are from the interpolated ones.

    Attributes
    ----------
    t
        (N,) increasing times, seconds.
    local
        (N, 12) local variables around the key state before.
    """

    t: Array = field(default_factory=lambda: np.empty(0))
    local: Array = field(default_factory=lambda: np.empty((0, 12)))

    def merged(self, states: States) -> States:
        """The key states, and between them those that deviate."""
        before, after = bracket(states.t, self.t)
        apart = np.minimum(self.t - states.t[before], states.t[after] - self.t)
        between = (apart > SAME_TIME) & (np.diff(self.t, prepend=-np.inf) > SAME_TIME)
        t, local, before = self.t[between], self.local[between], before[between]
        T, twist = np.empty((len(t), 4, 4)), np.empty((len(t), 6))
        _moved_states_kernel(states.T_world_cam, states.twist, states.t, before, t, local, T, twist)
        order = np.argsort(np.concatenate([states.t, t]), kind="stable")
        both = States.concatenate([states, States(t, T, twist)])
        return States(both.t[order], both.T_world_cam[order], both.twist[order])


@kernel
def _moved_states_kernel(
    T_key: Array,
    twist_key: Array,
    t_key: Array,
    before: Index,
    t: Array,
    deviation: Array,
    T: Array,
    twist: Array,
) -> None:
    for n in range(len(t)):
        i, j = before[n], before[n] + 1
        weights = hermite_weights(t[n] - t_key[i], t_key[j] - t[n])
        local_j = local_state_kernel(T_key[i], T_key[j], twist_key[j])
        local = interpolated_local_kernel(twist_key[i], local_j, weights)
        for m in range(12):
            local[m] += deviation[n, m]
        moved_kernel(T_key[i], local, T[n], twist[n])


def bridge_covariance(times: Array, duration: float) -> Array:
    """(2, 2, m, m) covariance of (xi, w) at times (m,) of a bridge, per unit spectral density.

    The bridge starts and ends with the known states at 0 and `duration`.
    """
    to_end = _wiener_covariance(times, np.array([duration]))[..., 0]
    at_end = _wiener_covariance(np.array([duration]), np.array([duration]))[..., 0, 0]
    known = np.einsum("ikm,kl,jln->ijmn", to_end, np.linalg.inv(at_end), to_end)
    return _wiener_covariance(times, times) - known


def _wiener_covariance(a: Array, b: Array) -> Array:
    """(2, 2, m, n) covariance of white noise on acceleration from a known state on."""
    a, b = a[:, None], b[None, :]
    first = np.minimum(a, b)
    xi_xi = first**2 * (3 * np.maximum(a, b) - first) / 6
    xi_w = np.where(a <= b, a**2 / 2, b * (a - b / 2))
    w_xi = np.where(b <= a, b**2 / 2, a * (b - a / 2))
    return np.array([[xi_xi, xi_w], [w_xi, first + 0 * (a + b)]])


@dataclass(frozen=True, eq=False)
class Bridge:
    """The measurements between two key states: rows (m, 3, 28) as of `stereo_kernel`.

    Attributes
    ----------
    rows, columns
        (m, 3, 28) derivatives and errors, and (m, 27) where the derivatives belong.
    by_local
        (m, 3, 6) derivative of the errors by xi at their own time.
    covariance
        (2, 2, m, m) of `bridge_covariance`.
    qc
        (6,) power spectral density.
    """

    rows: Array
    columns: Index
    by_local: Array
    covariance: Array
    qc: Array

    def add_normal(self, H: Array, g: Array) -> None:
        """Add what the measurements tell of the key states and landmarks."""
        landmark, place = np.unique(self.columns[:, 24], return_inverse=True)
        used = np.append(self.columns[0, :24], (landmark[:, None] + np.arange(3)).ravel())
        m = len(self.rows)
        dense = np.zeros((3 * m, len(used) + 1))
        lines = np.arange(3 * m).reshape(m, 3, 1)
        dense[:, :24] = self.rows[..., :24].reshape(3 * m, 24)
        dense[lines, 24 + 3 * place[:, None, None] + np.arange(3)] = self.rows[..., 24:27]
        dense[:, -1] = self.rows[..., -1].ravel()
        white, _ = lapack.dtrtrs(self._root, dense, lower=1)
        H[np.ix_(used, used)] += white[:, :-1].T @ white[:, :-1]
        g[used] += white[:, :-1].T @ white[:, -1]

    def deviations(self) -> Array:
        """(m, 12) most probable deviations from the interpolated states, given the errors."""
        solved, _ = lapack.dpotrs(self._root, self.rows[..., -1].ravel(), lower=1)
        pull = -self.qc * np.einsum("nij,ni->nj", self.by_local, solved.reshape(-1, 3))
        return np.hstack([self.covariance[0, 0] @ pull, self.covariance[1, 0] @ pull])

    @property
    def _root(self) -> Array:
        """(3 m, 3 m) Cholesky factor of the covariance of the errors."""
        by_local = self.by_local.reshape(-1, 6)
        spread = np.repeat(np.repeat(self.covariance[0, 0], 3, axis=0), 3, axis=1)
        whole = np.eye(len(by_local)) + spread * ((by_local * self.qc) @ by_local.T)
        root, _ = lapack.dpotrf(whole, lower=1)
        return root


def groups(interval: Index) -> Iterator[slice]:
    """Slices of equal entries of increasing numbers (N,)."""
    ends = np.flatnonzero(np.diff(interval, append=-1))
    start = 0
    for end in (ends + 1).tolist():
        yield slice(start, end)
        start = end
