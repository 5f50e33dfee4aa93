"""Measurements of short clusters, gathered until the estimator is updated."""

from __future__ import annotations

import numpy as np

from gpvo.config.stages import EstimatorConfig
from gpvo.estimator.beginning import Beginning
from gpvo.estimator.estimator import Estimator
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements


class GatheredMeasurements:
    """What clusters added since the estimator's latest update, which are an interval apart.

    In fast motion clusters are short, and an update costs about as much for one of them as for
    several. With an interval of 0 every cluster is an update. The first ones may have nothing to
    estimate, see `Beginning`.
    """

    def __init__(self, estimator: Estimator, config: EstimatorConfig) -> None:
        self._estimator, self._interval = estimator, config.interval
        self._beginning = Beginning(config.start_landmarks)
        self._waiting: list[Measurements] = []
        self._velocity: VelocityFit | None = None
        self._stop, self._updated = -np.inf, -np.inf

    def add(self, stop: float, measurements: Measurements, velocity: VelocityFit | None) -> None:
        """Add what a cluster added that ended at `stop`, seconds; update when it is time."""
        self._waiting.append(self._beginning.add(stop, measurements))
        self._stop, self._velocity = stop, velocity
        if stop - self._updated >= self._interval and not self._awaits_place(stop):
            self._update()

    def _awaits_place(self, stop: float) -> bool:
        """Return whether the estimator waits until landmarks tell where it is."""
        awaits = getattr(self._estimator, "awaits_place", None)
        return awaits is not None and awaits(stop, Measurements.concatenate(self._waiting))

    def prepare(self) -> None:
        """Let the estimator do what its next update needs, if it can before that."""
        prepare = getattr(self._estimator, "prepare", None)
        if prepare is not None:
            prepare()

    def end(self) -> None:
        """Update the estimator with what waits after the last cluster."""
        left = self._beginning.end()
        if len(left):
            self._waiting.append(left)
        self._update()

    def _update(self) -> None:
        if self._waiting:
            added, self._waiting = Measurements.concatenate(self._waiting), []
            self._estimator.update(self._stop, added, self._velocity)
            self._updated = self._stop
