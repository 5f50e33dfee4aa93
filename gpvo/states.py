"""States of a trajectory while it is estimated: their latest values, in order of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import extrapolate, interpolate

Array = NDArray[np.float64]


class States:
    """Growing arrays of times (K,), poses T_world_cam (K, 4, 4) and body twists (K, 6)."""

    def __init__(self) -> None:
        self.t = np.empty(0)
        self.T_world_cam = np.empty((0, 4, 4))
        self.twist = np.empty((0, 6))

    def __len__(self) -> int:
        return len(self.t)

    def replace_from(self, t: Array, T_world_cam: Array, twist: Array) -> None:
        """Replace all states from time t[0] on by these."""
        kept = int(np.searchsorted(self.t, t[0]))
        self.t = np.concatenate([self.t[:kept], t])
        self.T_world_cam = np.concatenate([self.T_world_cam[:kept], T_world_cam])
        self.twist = np.concatenate([self.twist[:kept], twist])

    def query(self, t: Array, twist_ahead: Array | None = None) -> tuple[Array, Array]:
        """Poses (N, 4, 4) and twists (N, 6) at times t (N,).

        Before the first and beyond the last state the motion goes on at the state's twist, or
        beyond the last one at `twist_ahead`.
        """
        inside = np.clip(t, self.t[0], self.t[-1])
        T, v = self._interpolate(inside)
        if twist_ahead is not None:
            v[t > self.t[-1]] = twist_ahead
        T, v, _ = extrapolate(T, v, t - inside)
        return T, v

    def _interpolate(self, t: Array) -> tuple[Array, Array]:
        if len(self) == 1:
            return np.repeat(self.T_world_cam, len(t), 0), np.repeat(self.twist, len(t), 0)
        j = np.clip(np.searchsorted(self.t, t, "right"), 1, len(self) - 1)
        i = j - 1
        state_i = self.T_world_cam[i], self.twist[i]
        state_j = self.T_world_cam[j], self.twist[j]
        T, v, _ = interpolate(*state_i, *state_j, self.t[i], self.t[j], t)
        return T, v
