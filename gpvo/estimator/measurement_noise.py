"""Variance of the measurements, learned from what the window's fit leaves of them.

Errors of consecutive measurements of a track are alike: they are of the same patch, on images that
share their contours. What is left of them after the fit is therefore less than what they are off,
and many of them say less than as many independent ones. CORRELATED accounts for both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CORRELATED = 6.0
"""Variance that measurements of tracks count with, over that of their residuals."""
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
        self._squares, self._redundancy = TRUST / CORRELATED, TRUST

    @property
    def information(self) -> Array:
        """(3,) present diagonal of R^-1."""
        scale = CORRELATED * self._squares / self._redundancy
        return self._start / float(np.clip(scale, LEAST, MOST))

    def is_due(self, t: float) -> bool:
        """Tell whether enough is new since it learned last, at a time in seconds."""
        return t - self._until >= self._memory / STEPS

    def learn(self, t: float, residuals: Array, redundancy: int) -> None:
        """Add what a fit leaves of measurements (N, 3), pixels, and its degrees of freedom."""
        keep = np.exp(-min(t - self._until, 10 * self._memory) / self._memory)
        self._until = t
        self._squares = keep * self._squares + float((residuals**2 @ self._start).sum())
        self._redundancy = keep * self._redundancy + redundancy
