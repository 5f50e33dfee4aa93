"""The states at the measurements' own times, given back after the graph was solved."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array
from factors.kernels.se3 import Array
from factors.structureless.bridge import Bridge
from factors.structureless.joint_system import JointSystem
from factors.structureless.states_between_kernels import state_rows_kernel, states_between_kernel

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class StatesBetween:
    """States at unique times between those of a graph.

    Attributes
    ----------
    measured
        (n,) times of measurements, seconds.
    t_states, T_states, v_states
        (m,), (m, 4, 4) and (m, 6) states of the graph.
    """

    measured: Array
    t_states: Array
    T_states: Array
    v_states: Array
    _bridges: list[Bridge]
    _system: JointSystem
    _mean: Array
    _qc_root: Array

    @staticmethod
    def given(
        system: JointSystem,
        bridges: list[Bridge],
        moved: Array,
        measured: Array,
        qc_root: Array,
        t_states: Array,
        T_states: Array,
        v_states: Array,
    ) -> StatesBetween:
        """The states, given a step (12 m,) since the system was linearised."""
        mean = system.shared_mean(moved)
        return StatesBetween(measured, t_states, T_states, v_states, bridges, system, mean, qc_root)

    @cached_property
    def t(self) -> Array:
        """(m,) increasing times of measurements, each once."""
        return np.unique(self.measured)

    def states(self, t: ArrayLike | None = None) -> tuple[Array, Array]:
        """Poses (n, 4, 4) and twists (n, 6) at times (n,) within the states, by default at `t`.

        Raises
        ------
        ValueError
            If a time lies outside.
        """
        t = self.t if t is None else checked_array("t", t, ()).ravel()
        T, v = np.empty((len(t), 4, 4)), np.empty((len(t), 6))
        first, deviation = self._interval(t), np.empty((len(t), 12))
        for i in np.unique(first):
            deviation[first == i] = self._deviation(int(i), t[first == i])
        a, b = t - self.t_states[first], np.maximum(self.t_states[first + 1] - t, 0.0)
        states_between_kernel(self.T_states, self.v_states, first, a, b, deviation, T, v)
        return T, v

    def joint_covariances(self, t: Array, covariance: Array) -> Array:
        """(n - 1, 24, 24) of the states at increasing times (n,), of each and the next.

        No state of the graph lies between two of the times. `covariance` (12 m, 12 m) is that of
        these states; poses are perturbed on the right.
        """
        joint = np.empty((max(len(t) - 1, 0), 24, 24))
        interval = self._interval(0.5 * (t[:-1] + t[1:]))
        for i in np.unique(interval):
            pairs = np.flatnonzero(interval == i)
            times = t[pairs[0] : pairs[-1] + 2]
            spread = self._covariance_within(int(i), times, covariance)
            for k, pair in enumerate(pairs.tolist()):
                joint[pair] = spread[12 * k : 12 * k + 24, 12 * k : 12 * k + 24]
        return joint

    def _covariance_within(self, i: int, t: Array, covariance: Array) -> Array:
        """(12 n, 12 n) of the states at times (n,) between the states i and i + 1."""
        _, _, by_local, by_pose_i, by_states = self._linearized(i, t)
        M = by_local @ by_states
        M[:, :6, :6] += by_pose_i
        bridge = self._bridges[i]
        u_by_states, u_covariance = self._system.part_given_states(self._variables(i))
        weights = self._qc_root[:, None] * bridge.weights(t - self.t_states[i])[:, :, None]
        by_u = np.zeros((len(t), 2, 6, 6, bridge.rank))
        for q in range(6):
            by_u[:, :, q, q] = weights[:, :, q].transpose(1, 0, 2)
        N = (by_local @ by_u.reshape(len(t), 12, 6 * bridge.rank)).reshape(
            12 * len(t), 6 * bridge.rank
        )
        # With respect to all states: those around the interval, and all others by way of u.
        on_states = N @ u_by_states
        on_states[:, 12 * i : 12 * i + 24] += M.reshape(-1, 24)
        total = on_states @ covariance @ on_states.T + N @ u_covariance @ N.T
        left = bridge.left(t - self.t_states[i])
        rest = np.einsum("hkmn,q,qp->mhqnkp", left, self._qc_root**2, np.eye(6))
        rest = rest.reshape(len(t), 12, -1)
        rest = (by_local @ rest).reshape(-1, len(t), 12)
        total += np.einsum("inj,nkj->ink", rest, by_local).reshape(total.shape)
        return 0.5 * (total + total.T)

    def _linearized(self, i: int, t: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return what `state_rows_kernel` does, at times (n,) between the states i and i + 1."""
        T, v = self.T_states[i : i + 2], self.v_states[i : i + 2]
        a, b = t - self.t_states[i], np.maximum(self.t_states[i + 1] - t, 0.0)
        return state_rows_kernel(T[0], v[0], T[1], v[1], a, b, self._deviation(i, t))

    def _deviation(self, i: int, t: Array) -> Array:
        """(n, 12) local deviations at times (n,) between the states i and i + 1."""
        bridge, u = self._bridges[i], self._mean[self._variables(i)]
        components = self._qc_root[:, None] * u.reshape(6, bridge.rank)
        return bridge.deviations(t - self.t_states[i], components)

    def _variables(self, i: int) -> slice:
        """Columns of the variables between the states i and i + 1."""
        return slice(int(self._system.latent[i]), int(self._system.latent[i + 1]))

    def _interval(self, t: Array) -> Index:
        """(n,) number of the state before each time."""
        if len(t) and not (self.t_states[0] <= t.min() and t.max() <= self.t_states[-1]):
            span = f"{self.t_states[0]} to {self.t_states[-1]}"
            raise ValueError(f"t from {t.min()} to {t.max()} must lie within the states', {span}")
        before = np.searchsorted(self.t_states, t, "right") - 1
        return np.clip(before, 0, len(self.t_states) - 2)
