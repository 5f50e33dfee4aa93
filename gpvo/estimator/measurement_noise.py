"""Variance of the measurements, learned from what the window's fit leaves of them.

Errors of consecutive measurements of a track are alike: they are of the same patch, on images that
share their contours. What is left of them after the fit is therefore less than what they are off,
and many of them say less than as many independent ones. Both grow as measurements follow each other
faster: with the time dt between them, the variance counts sqrt(ALIKE / dt) times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ALIKE = 1.7
"""Seconds: with it steps of simulated recordings are best; twice as much smooths drones that shake,
and a third of it lets noise through."""
USUAL = 6.0
"""Number of measurements of a track that are alike, before it is known."""
LEAST, MOST = 0.02, 100.0
"""Bounds of what is learned, as a share of the variance at the start."""
STEPS = 20
"""How often it learns during the memory: the same measurements stay in the window for a while."""
TRUST = 1000.0
"""Number of measurements that the value at the start counts for."""


class MeasurementNoise:
    """Estimates R^-1 over the recent past: its diagonal's scale.

    Parameters
    ----------
    start
        (3,) diagonal of R^-1 to begin with.
    memory
        Seconds after which what was seen counts 1/e of what is seen now.
    """

    def __init__(self, start: Array, memory: float) -> None:
        self._start, self._memory, self._until = start, memory, -np.inf
        self._squares, self._redundancy, self._alike = TRUST / USUAL, TRUST, USUAL

    @property
    def information(self) -> Array:
        """(3,) present diagonal of R^-1."""
        scale = self._alike * self._squares / self._redundancy
        return self._start / float(np.clip(scale, LEAST, MOST))

    def is_due(self, t: float) -> bool:
        """Tell whether enough is new since it learned last, at a time in seconds."""
        return t - self._until >= self._memory / STEPS

    def learn(self, t: float, residuals: Array, redundancy: int, interval: float) -> None:
        """Add what a fit leaves of measurements (N, 3), pixels, and its degrees of freedom.

        The interval is the mean time between consecutive measurements of a track, seconds.
        """
        keep = np.exp(-min(t - self._until, 10 * self._memory) / self._memory)
        self._until, self._alike = t, max(1.0, float(np.sqrt(ALIKE / interval)))
        self._squares = keep * self._squares + float((residuals**2 @ self._start).sum())
        self._redundancy = keep * self._redundancy + redundancy
