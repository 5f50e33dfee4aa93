"""The path as it is known now: what is final, and the window as estimated at this moment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator import Estimator

Array = NDArray[np.float64]

STEP = 0.005
"""Seconds between points, at least."""


class PathSoFar:
    """Collects the final positions of an estimator."""

    def __init__(self) -> None:
        self._final: list[Array] = []
        self._last = -np.inf

    def __call__(self, estimator: Estimator) -> Array:
        """Return the positions (N, 3) so far, metres."""
        new, window = estimator.final_states(self._last), estimator.states
        if len(new):
            self._last = float(new.t[-1])
            self._final.append(_sparse(new.t, new.T_world_cam[:, :3, 3]))
        return np.concatenate([*self._final, _sparse(window.t, window.T_world_cam[:, :3, 3])])


def _sparse(t: Array, positions: Array) -> Array:
    """Return the first position in each `STEP`, and the last one."""
    if len(t) == 0:
        return np.empty((0, 3))
    _, first = np.unique(np.floor(t / STEP), return_index=True)
    return positions[np.union1d(first, len(t) - 1)]
