"""Observer that keeps the measurements of inliers, of which the map is made after the run."""

from __future__ import annotations

from gpvo.observer import Step
from gpvo.tracking import Measurements


class MeasurementRecorder:
    """Keeps the measurements that the estimator was given."""

    def __init__(self) -> None:
        self._parts: list[Measurements] = []

    def __call__(self, step: Step) -> None:
        """Keep those of one more cluster."""
        self._parts.append(step.tracked.measurements)

    @property
    def measurements(self) -> Measurements:
        """All of them so far."""
        return Measurements.concatenate(self._parts)
