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

from factors.kernels.local_variables import (
    hermite_weights,
    interpolated_local_kernel,
    local_state_kernel,
    retract_kernel,
)
from factors.kernels.se3 import kernel
from gpvo.estimator.graph_builder import SAME_TIME
from gpvo.estimator.normal_kernels import add_bridge_kernel
from gpvo.trajectory.states import States, bracket

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
        retract_kernel(T_key[i], local, T[n], twist[n])


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
    """The measurements between two key states.

    Attributes
    ----------
    rows, by_local
        (m, 3, 28) derivatives and errors, and (m, 3, 6) derivative of the errors by xi at their own
        time, as of `stereo_kernel`.
    times, duration
        (m,) of the measurements, and of the second state, after the first state.
    qc
        (6,) power spectral density.
    """

    rows: Array
    by_local: Array
    times: Array
    duration: float
    qc: Array

    def add_normal(self, landmark: Index, state: Index, H: Array, g: Array) -> None:
        """Add what the measurements tell of the key states and landmarks.

        The columns of the landmarks (m,) and of both states begin at `landmark` and `state`; of H
        the upper triangle is added to.
        """
        rows, root = self.rows.reshape(-1, 28), self._root
        solved, _ = lapack.dpotrs(root, rows[:, _STATES_AND_ERROR], lower=1)
        information, _ = lapack.dpotri(root, lower=1, overwrite_c=1)
        solved = np.ascontiguousarray(solved).reshape(-1, 3, 25)
        add_bridge_kernel(self.rows, information.T, solved, landmark, state, H, g)

    def deviations(self) -> Array:
        """(m, 12) most probable deviations from the interpolated states, given the errors."""
        solved, _ = lapack.dpotrs(self._root, self.rows[..., -1].ravel(), lower=1)
        pull = -self.qc * np.einsum("nij,ni->nj", self.by_local, solved.reshape(-1, 3))
        xi, twist = bridge_covariance(self.times, self.duration)[:, 0]
        return np.hstack([xi @ pull, twist @ pull])

    @property
    def _root(self) -> Array:
        """(3 m, 3 m) Cholesky factor, lower, of the covariance of the errors."""
        covariance = errors_covariance_kernel(self.by_local, self.times, self.duration, self.qc)
        root, _ = lapack.dpotrf(covariance.T, lower=1, clean=0, overwrite_a=1)
        return root


_STATES_AND_ERROR = np.append(np.arange(24), 27)


@kernel
def errors_covariance_kernel(by_local: Array, times: Array, duration: float, qc: Array) -> Array:
    """(3 m, 3 m) covariance of errors of unit variance whose states deviate; see `Bridge`.

    1 + B K Bᵀ, with K the covariance of xi of `bridge_covariance`; only the upper triangle.
    """
    m, d = len(times), duration
    result, to_end = np.zeros((3 * m, 3 * m)), np.empty((m, 2))
    for i in range(m):
        to_end[i, 0] = times[i] * times[i] * (3 * d - times[i]) / 6
        to_end[i, 1] = times[i] * times[i] / 2
    a, b, c = 12 / (d * d * d), -6 / (d * d), 4 / d  # inverse covariance at the end
    for i in range(m):
        for j in range(i, m):
            first, last = min(times[i], times[j]), max(times[i], times[j])
            spread = first * first * (3 * last - first) / 6
            spread -= to_end[i, 0] * (a * to_end[j, 0] + b * to_end[j, 1])
            spread -= to_end[i, 1] * (b * to_end[j, 0] + c * to_end[j, 1])
            for r in range(3):
                for s in range(3):
                    value = 0.0
                    for k in range(6):
                        value += by_local[i, r, k] * qc[k] * by_local[j, s, k]
                    result[3 * i + r, 3 * j + s] = spread * value
    for i in range(3 * m):
        result[i, i] += 1.0
    return result


def groups(interval: Index) -> Iterator[slice]:
    """Slices of equal entries of increasing numbers (N,)."""
    ends = np.flatnonzero(np.diff(interval, append=-1))
    start = 0
    for end in (ends + 1).tolist():
        yield slice(start, end)
        start = end
