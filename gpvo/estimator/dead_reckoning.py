"""How the motion goes on where nothing measures it.

The WNOA prior keeps the velocity. That bridges a moment, but not a camera that stopped, or a cable
that came loose. After some time, `bridge`, the velocity is therefore forgotten within `MEMORY` (an
Ornstein-Uhlenbeck process): its mean decays, and its standard deviation becomes the speed that was
seen last. The position then stays, and its covariance holds both hypotheses, that the camera
stands still and that it goes on.

For states dt apart, K = dt / MEMORY and the stationary variance s^2, the prior with Q_c =
s^2 / (MEMORY (1 - K)) and a measurement of zero velocity with the variance s^2 / K have it as the
solution of their Riccati equation.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V
from numpy.typing import NDArray

from gpvo.estimator.initialization import FIXED, InitialState
from gpvo.trajectory.states import States

Array = NDArray[np.float64]

MEMORY = 0.25
"""Seconds after which a velocity that is not measured is forgotten."""
LEAST_SPEED = np.array([0.2, 0.2])
"""Least standard deviation of a velocity that is not measured, rad/s and m/s."""
ENOUGH = 6
"""Number of measurements that measure a motion."""


class DeadReckoning:
    """Where the motion is not measured for more than `bridge` seconds, and how it is guessed.

    With 0 seconds the velocity is kept for ever.
    """

    def __init__(self, bridge: float) -> None:
        self._bridge = bridge or np.inf
        self._measured, self._speed = np.inf, LEAST_SPEED
        self._breaks: list[tuple[float, float, Array]] = []

    def measured(self, t: float, twist: Array, count: int) -> None:
        """Note that so many measurements reach until t, seconds, where the twist (6,) is known."""
        if count >= ENOUGH or not np.isfinite(self._measured):
            self._measured = t
            self._speed = np.maximum(np.linalg.norm(twist.reshape(2, 3), axis=1), LEAST_SPEED)

    def extend(self, start: float, stop: float) -> None:
        """Note the time between two clusters' ends, before the motion in it is estimated."""
        if start - self._measured >= self._bridge - 1e-6:
            self._breaks.append((start, stop, np.repeat(self._speed, 3)))

    def forget(self, t: float) -> None:
        """Forget what lies before t, seconds."""
        self._breaks = [one for one in self._breaks if one[1] > t]

    def is_over(self, count: int) -> bool:
        """Return whether so many new measurements end a time that was guessed."""
        return count >= ENOUGH and bool(self._breaks) and self._breaks[-1][1] > self._measured

    def state_after(self, states: States) -> InitialState:
        """Return the state that a new segment begins with, the last of the guessed ones."""
        covariance = np.diag(np.append(np.full(6, FIXED**2), np.repeat(self._speed, 3) ** 2))
        return InitialState(states.T_world_cam[-1], np.zeros(6), covariance)

    @property
    def in_window(self) -> bool:
        """Whether some of what is not forgotten was guessed."""
        return bool(self._breaks)

    def densities(self, t: Array, usual: Array) -> Array:
        """Return Q_c (K - 1, 6) between states at times t (K,), where `usual` (6,) is measured."""
        middle, dt = 0.5 * (t[:-1] + t[1:]), np.diff(t)
        density = np.tile(usual, (len(dt), 1))
        for k in range(len(dt)):
            speed = self._at(middle[k])
            if speed is not None:
                density[k] = np.maximum(usual, speed**2 / (MEMORY * (1 - _gain(dt[k]))))
        return density

    def at_rest(self, numbers: range, t: Array) -> list[gtsam.NonlinearFactor]:
        """Make the measurements of zero velocity of the states but the first, at times t (K,)."""
        factors: list[gtsam.NonlinearFactor] = []
        for k in range(1, len(t)):
            speed = self._at(0.5 * (t[k - 1] + t[k]))
            if speed is not None:
                sigma = speed / np.sqrt(_gain(t[k] - t[k - 1]))
                noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
                factors.append(gtsam.PriorFactorVector(V(numbers[k]), np.zeros(6), noise))
        return factors

    def _at(self, t: float) -> Array | None:
        """Standard deviation (6,) of the velocity at t; None where the motion is measured."""
        return next((speed for start, stop, speed in self._breaks if start <= t < stop), None)


def _gain(dt: float) -> float:
    return float(np.clip(dt / MEMORY, 1e-6, 0.5))
