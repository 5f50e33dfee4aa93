"""The acceleration that a motion goes on with, until both sides of it are measured.

Landmarks are measured in the middle of a cluster, and where the camera was tells its velocity only
together with where it is later. The newest velocity is that of the WNOA prior's mean, which keeps
the one before: while a hand turns back at 4 m/s^2, it is 0.3 m/s behind. The white noise of the
latest priors is therefore about the acceleration that was seen before them. Older ones are about
zero, as in the paper: states on both sides know the motion between better than what was before.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator.state_times import SAME_TIME
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
AHEAD = 2
"""Number of updates until a motion is measured from both sides."""
LEAST = 3
"""Number of states that tell an acceleration."""


class _Ahead(NamedTuple):
    """A time between two updates, seconds, and the mean acceleration (6,) there."""

    start: float
    stop: float
    acceleration: Array


class AccelerationAhead:
    """The mean of the acceleration in the latest updates, by the velocities before each of them.

    They are remembered for `memory` times the update's own time.
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._latest: deque[_Ahead] = deque(maxlen=AHEAD)

    def extend(self, known: States, start: float, stop: float) -> None:
        """Go on from `start` to `stop`, seconds, as the states (K,) did that are known."""
        acceleration = mean_acceleration(known, self._memory * (stop - start))
        self._latest.append(_Ahead(start, stop, acceleration))

    @property
    def latest(self) -> Array:
        """Mean (6,) in the latest update, rad/s^2 and m/s^2; 0 before the first one."""
        return self._latest[-1].acceleration if self._latest else np.zeros(6)

    def between(self, t: Array) -> Array:
        """Return the mean (K - 1, 6) between states at times t (K,), rad/s^2 and m/s^2."""
        middle, mean = 0.5 * (t[:-1] + t[1:]), np.zeros((max(len(t) - 1, 0), 6))
        for one in self._latest:
            mean[(one.start <= middle) & (middle < one.stop)] = one.acceleration
        return mean


def mean_acceleration(states: States, duration: float) -> Array:
    """Compute the acceleration (6,) in the last `duration` seconds of states, by least squares.

    It is zero for fewer than `LEAST` states there.
    """
    latest = states.after(states.t[-1] - duration - SAME_TIME) if len(states) else states
    if len(latest) < LEAST:
        return np.zeros(6)
    since = latest.t - latest.t.mean()
    return np.asarray(since @ latest.twist / (since @ since))
