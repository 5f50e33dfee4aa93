"""How certain the newest velocities are, by what later updates made of those before.

A velocity that is measured from one side rests on the acceleration before it, which white noise, a
hand and a car keep differently well. Once it is measured from both sides its error shows: the
correction that it got has the covariance C - C', of what it was and is uncertain by, if both are
right. Its mean square relative to that, over the recent past, scales the newest covariances. Where
that is less than `velocity_share` the motion is as smooth amid other states.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator.acceleration_ahead import AHEAD
from gpvo.estimator.state_times import SAME_TIME
from gpvo.trajectory.smooth_motion import velocity_scale
from gpvo.trajectory.states import States

Array = NDArray[np.float64]

TRUST = 3.0
"""Number of axes of velocities, as good as their covariances say, that the past begins with."""
ONE_LATER = 0.5
"""Share of the newest variances' scale one update later, and until AHEAD are over: 0.4 to 0.5 in
hand-held, fast and noisy motion, 0.7 in others, and 1 in slow motion, where it is small."""


class _Newest(NamedTuple):
    """A velocity as it was when it was the newest: time in seconds, twist (6,), variances (6,)."""

    t: float
    twist: Array
    variance: Array


class NewestVelocity:
    """Learns by what the standard deviations of the newest velocities are to be multiplied.

    Parameters
    ----------
    memory
        Seconds after which what was seen counts 1/e of what is seen now; with 0 it is always 1.
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._before: deque[_Newest] = deque(maxlen=AHEAD)
        self._squares = self._expected = 0.0
        self._t: list[float] = []
        self._scale: list[float] = []

    @property
    def learns(self) -> bool:
        """Whether it has a memory."""
        return self._memory > 0

    @property
    def scale(self) -> float:
        """What standard deviations are multiplied by at the end of the latest update."""
        return self._scale[-1] if self._scale else 1.0

    def learn(self, keys: States, covariance: Array) -> None:
        """Compare key states (K,), of a covariance (12 K, 12 K), with those that were newest."""
        variance = np.diagonal(covariance).reshape(-1, 12)[:, 6:]
        if len(self._before) == AHEAD:
            self._compare(self._before[0], keys, variance)
        self._before.append(_Newest(float(keys.t[-1]), keys.twist[-1].copy(), variance[-1].copy()))

    def _compare(self, before: _Newest, keys: States, variance: Array) -> None:
        place = int(np.searchsorted(keys.t, before.t - SAME_TIME))
        keep = np.exp(-(keys.t[-1] - self._before[-1].t) / self._memory)
        self._squares, self._expected = keep * self._squares, keep * self._expected
        if abs(keys.t[place] - before.t) <= SAME_TIME:
            correction = (keys.twist[place] - before.twist) ** 2 / before.variance
            expected = 1.0 - variance[place] / before.variance
            self._squares += float(correction.sum())
            self._expected += float(np.maximum(expected, 0.0).sum())

    def forget(self) -> None:
        """Compare none of those before with what comes: the motion between was guessed."""
        self._before.clear()

    def end(self, t: float, is_guessed: bool) -> None:
        """Note the scale at the end of an update, at t seconds; 1 where the motion is guessed."""
        scale = np.sqrt((self._squares + TRUST) / (self._expected + TRUST))
        self._t.append(t)
        self._scale.append(1.0 if is_guessed else float(scale))

    def at(self, knot_t: Array, share: float) -> Array:
        """Return the scale (M,) at increasing times (M,), seconds; `share` is that amid others."""
        scale = velocity_scale(knot_t, share)
        if not self.learns or not self._t:
            return scale
        smoothest = np.minimum(scale, np.interp(knot_t, self._t, self._scale))
        scale = np.where(scale < 1.0, smoothest, scale)
        t, is_new = self._t[-AHEAD - 1 :], knot_t >= self._t[-AHEAD - 1 :][0]
        share_of_newest = np.append(np.full(len(t) - 1, np.sqrt(ONE_LATER)), 1.0)
        scale[is_new] = self.scale * np.interp(knot_t[is_new], t, share_of_newest)
        return scale
