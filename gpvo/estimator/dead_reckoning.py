"""How the motion goes on where nothing measures it.

The WNOA prior keeps the velocity. That bridges a moment, but not a camera that stopped, or a cable
that came loose. The Q_c of steady motion is also too small for a longer time: after `LOOSE` seconds
it lets the velocity change by the speed s that was seen lately within `CHANGE`. After some time,
`bridge`, the velocity is forgotten within `MEMORY` (an Ornstein-Uhlenbeck process): its mean
decays, and its standard deviation becomes s. The position then stays, and its covariance holds both
hypotheses, that the camera stands still and that it goes on.

For states dt apart, K = dt / MEMORY and the stationary variance s^2, the prior with Q_c =
s^2 / (MEMORY (1 - K)) and a measurement of zero velocity with the variance s^2 / K have it as the
solution of their Riccati equation.
"""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V
from numpy.typing import NDArray

from gpvo.estimator.initialization import FIXED, InitialState
from gpvo.estimator.state_times import SAME_TIME

Array = NDArray[np.float64]

LOOSE, CHANGE = 0.2, 1.0
"""Seconds without measurements after which motion is not steady, and in which it changes."""
MEMORY = 0.25
"""Seconds after which a velocity that is not measured is forgotten."""
LEAST_SPEED = np.array([0.6, 0.6])
"""Least standard deviation of a velocity that is not measured, rad/s and m/s."""
LIVELY = 1.5
"""How much faster than lately the motion may be."""
REMEMBERED = 4.0
"""Seconds after which the largest speed that was seen counts 1/e."""
MOST_STEPS = 40
"""Number of states in a break: enough for MEMORY in one of 5 s, in longer ones they are sparser."""
HELD = 1.75
"""Longest break over which the states before it are held, seconds.

Errors are 0.6 times as large so after breaks of 1.5 s, but 1.9 times after those of 3 s.
"""
ENOUGH = 6
"""Number of measurements that measure a motion."""


class DeadReckoning:
    """Where the motion is not measured for more than `bridge` seconds, and how it is guessed.

    With 0 seconds the velocity is kept for ever.
    """

    def __init__(self, bridge: float) -> None:
        self._bridge = bridge or np.inf
        self._measured, self._speed, self._seen = np.inf, LEAST_SPEED, np.inf
        self._guessed: list[_Guess] = []

    def measured(self, t: float, twist: Array, count: int) -> None:
        """Note that so many measurements reach until t, seconds, where the twist (6,) is known."""
        self._seen = np.inf
        if count >= ENOUGH or not np.isfinite(self._measured):
            passed = max(t - self._measured, 0.0) if np.isfinite(self._measured) else 0.0
            known = np.maximum(self._speed * np.exp(-passed / REMEMBERED), LEAST_SPEED)
            self._measured = t
            self._speed = np.maximum(np.linalg.norm(twist.reshape(2, 3), axis=1), known)

    def steps(self, last: float, until: float) -> Array:
        """Return times of states in a break after the last state, which ends at `until`, seconds.

        They are where the motion is guessed otherwise than before. None in a short break.
        """
        if not until - max(last, self._measured) > self._bridge + SAME_TIME:
            return np.empty(0)
        loose = self._measured + min(LOOSE, self._bridge)
        forgotten = self._measured + self._bridge
        count = min(int(np.ceil((until - forgotten) / (MEMORY / 2))), MOST_STEPS)
        t = np.append(loose, np.linspace(forgotten, until, count + 1))
        return t[t > last + SAME_TIME]

    def see(self, t: float) -> None:
        """Note that measurements begin at t, seconds, after a break: what follows is no guess."""
        self._seen = t

    def extend(self, start: float, stop: float) -> None:
        """Note the time between two clusters' ends, before the motion in it is estimated."""
        if start < self._seen and self.is_guessed(start):
            forgotten = start - self._measured >= self._bridge - 1e-6
            speed = LIVELY * np.repeat(self._speed, 3)
            self._guessed.append(_Guess(start, stop, speed, forgotten))

    def forget(self, t: float) -> None:
        """Forget what lies before t, seconds."""
        self._guessed = [one for one in self._guessed if one.stop > t]

    def is_over(self, count: int) -> bool:
        """Return whether so many new measurements end a time that was guessed."""
        if count < ENOUGH or not self._guessed:
            return False
        return self._guessed[-1].forgotten and self._guessed[-1].stop > self._measured

    def is_guessed(self, t: float) -> bool:
        """Return whether nothing is measured for so long before t, seconds, that it is guessed."""
        unknown = t - self._measured
        return np.isfinite(self._bridge) and unknown >= min(LOOSE, self._bridge) - 1e-6

    def holds(self, t: float) -> bool:
        """Return whether a break up to t, seconds, is so short that what was before is held."""
        return np.isfinite(self._bridge) and t - self._measured < HELD

    def state_after(self, T_world_cam: Array) -> InitialState:
        """Return the state that a new segment begins with, at a pose (4, 4)."""
        covariance = np.diag(
            np.append(np.full(6, FIXED**2), LIVELY**2 * np.repeat(self._speed, 3) ** 2)
        )
        return InitialState(T_world_cam, np.zeros(6), covariance)

    def end(self, t: float) -> None:
        """Note that the motion is measured again from time t, seconds."""
        self._measured, self._guessed = t, []

    @property
    def measured_until(self) -> float:
        """Time until which the motion is measured, seconds; it is guessed from there on."""
        return self._measured

    @property
    def speed(self) -> Array:
        """(2,) largest speed that was seen lately, rad/s and m/s."""
        return self._speed

    @property
    def in_window(self) -> bool:
        """Whether some of what is not forgotten was guessed."""
        return bool(self._guessed)

    def densities(self, t: Array, usual: Array) -> Array:
        """Return Q_c (K - 1, 6) between states at times t (K,), where `usual` (6,) is measured."""
        middle, dt = 0.5 * (t[:-1] + t[1:]), np.diff(t)
        density = np.tile(usual, (len(dt), 1))
        for k in range(len(dt)):
            guess = self._at(middle[k])
            if guess is not None:
                memory = MEMORY * (1 - _gain(dt[k])) if guess.forgotten else CHANGE
                density[k] = np.maximum(usual, guess.speed**2 / memory)
        return density

    def at_rest(self, numbers: range, t: Array) -> list[gtsam.NonlinearFactor]:
        """Make the measurements of zero velocity of the states but the first, at times t (K,)."""
        factors: list[gtsam.NonlinearFactor] = []
        for k in range(1, len(t)):
            guess = self._at(0.5 * (t[k - 1] + t[k]))
            if guess is not None and guess.forgotten:
                sigma = guess.speed / np.sqrt(_gain(t[k] - t[k - 1]))
                noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
                factors.append(gtsam.PriorFactorVector(V(numbers[k]), np.zeros(6), noise))
        return factors

    def _at(self, t: float) -> _Guess | None:
        """What is guessed at t; None where the motion is measured."""
        return next((one for one in self._guessed if one.start <= t < one.stop), None)


class _Guess(NamedTuple):
    """A time between clusters' ends, the speed (6,) there, and if the velocity is forgotten."""

    start: float
    stop: float
    speed: Array
    forgotten: bool


def _gain(dt: float) -> float:
    return float(np.clip(dt / MEMORY, 1e-6, 0.5))
