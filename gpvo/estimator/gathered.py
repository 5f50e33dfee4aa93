"""Measurements of short clusters, gathered until the estimator is updated."""

from __future__ import annotations

import numpy as np

from gpvo.estimator.estimator import Estimator
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements


class GatheredMeasurements:
    """What clusters added since the estimator's latest update, which are an interval apart.

    In fast motion clusters are short, and an update costs about as much for one of them as for
    several. `interval` is in seconds; with 0 every cluster is an update.
    """

    def __init__(self, estimator: Estimator, interval: float) -> None:
        self._estimator, self._interval = estimator, interval
        self._waiting: list[Measurements] = []
        self._velocity: VelocityFit | None = None
        self._stop, self._updated = -np.inf, -np.inf

    def add(self, stop: float, measurements: Measurements, velocity: VelocityFit | None) -> None:
        """Add what a cluster added that ended at `stop`, seconds; update when it is time."""
        self._waiting.append(measurements)
        self._stop, self._velocity = stop, velocity
        if stop - self._updated >= self._interval:
            self.flush()

    def prepare(self) -> None:
        """Let the estimator do what its next update needs, if it can before that."""
        prepare = getattr(self._estimator, "prepare", None)
        if prepare is not None:
            prepare()

    def flush(self) -> None:
        """Update the estimator with what waits."""
        if self._waiting:
            added, self._waiting = Measurements.concatenate(self._waiting), []
            self._estimator.update(self._stop, added, self._velocity)
            self._updated = self._stop
