"""How long states stay in the window."""

from __future__ import annotations

from collections import deque

import numpy as np

from gpvo.config.stages import EstimatorConfig


class Lag:
    """The window: the latest clusters, or the latest seconds if the configuration has a lag."""

    def __init__(self, config: EstimatorConfig) -> None:
        self._seconds = config.lag
        self._ends: deque[float] = deque(maxlen=config.window)
        self.position = 0.0
        """How far the window has moved so far, in lengths of its own."""

    def advance(self, stop: float) -> None:
        """A cluster has ended at `stop`, or none later than the last one."""
        previous = self.stop
        self._ends.append(max([stop, *self._ends]))
        step = self.stop - previous
        if np.isfinite(step) and self._seconds is not None:
            self.position += step / (self._seconds + step)
        elif np.isfinite(step):
            self.position += 1 / float(self._ends.maxlen or 1)

    @property
    def stop(self) -> float:
        """End of the latest cluster, seconds; -inf before the first."""
        return self._ends[-1] if self._ends else -np.inf

    @property
    def start(self) -> float:
        """States before it leave the window: seconds, -inf while the window is not full."""
        if self._seconds is not None:
            return self.stop - self._seconds
        return self._ends[0] if len(self._ends) == self._ends.maxlen else -np.inf
