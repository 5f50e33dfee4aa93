"""Latest values of a trajectory's states during the estimation, in order of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from factors import extrapolate, interpolate
from gpvo.array_table import ArrayTable

Array = NDArray[np.float64]


@dataclass(eq=False)
class States(ArrayTable):
    """Increasing times (K,), poses T_world_cam (K, 4, 4) and body twists (K, 6), rotation first."""

    t: Array = field(default_factory=lambda: np.empty(0))
    T_world_cam: Array = field(default_factory=lambda: np.empty((0, 4, 4)))
    twist: Array = field(default_factory=lambda: np.empty((0, 6)))

    @property
    def nbytes(self) -> int:
        """Size of the arrays, bytes."""
        return self.t.nbytes + self.T_world_cam.nbytes + self.twist.nbytes

    def after(self, t: float) -> States:
        """Return the states later than t."""
        return self[int(np.searchsorted(self.t, t, "right")) :]

    def at(self, t: Array, twist_ahead: Array | None = None) -> States:
        """Return the states at times t (N,), see `query`."""
        return States(t, *self.query(t, twist_ahead))

    def query(self, t: Array, twist_ahead: Array | None = None) -> tuple[Array, Array]:
        """Return the poses (N, 4, 4) and twists (N, 6) at times t (N,).

        They are interpolated between states. Before the first state and after the last one the
        motion continues at that state's twist; after the last one at `twist_ahead` if given.
        """
        inside = np.clip(t, self.t[0], self.t[-1])
        T, twist = self._interpolate(inside)
        if twist_ahead is not None:
            twist[t > self.t[-1]] = twist_ahead
        if (inside == t).all():
            return T, twist
        T, twist, _ = extrapolate(T, twist, t - inside)
        return T, twist

    def _interpolate(self, t: Array) -> tuple[Array, Array]:
        if len(self) == 1:
            return np.repeat(self.T_world_cam, len(t), 0), np.repeat(self.twist, len(t), 0)
        i, j = bracket(self.t, t)
        state_i = self.T_world_cam[i], self.twist[i]
        state_j = self.T_world_cam[j], self.twist[j]
        T, twist, _ = interpolate(*state_i, *state_j, self.t[i], self.t[j], t)
        return T, twist


def bracket(knots: Array, t: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices (N,) of the knots before and after times t (N,); knots (K,) increase."""
    after = np.clip(np.searchsorted(knots, t, "right"), 1, len(knots) - 1)
    return after - 1, after


def later_states(parts: Sequence[States], after: float) -> States:
    """Return the states later than `after` from parts in order of time."""
    later: list[States] = []
    for part in reversed(parts):
        if part.t[-1] <= after:
            break
        later.insert(0, part.after(after))
    return States.concatenate([States(), *later])
