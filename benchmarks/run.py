"""One run of the odometry, and its cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpvo.config import Configuration
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.report.run_time import Cost, CostMeter
from gpvo.odometry import Odometry
from gpvo.recordings import Recording
from gpvo.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Run:
    """A trajectory and its cost."""

    trajectory: Trajectory
    cost: Cost

    @property
    def poses(self) -> ContinuousPoses:
        """Poses of the trajectory, for comparisons."""
        return ContinuousPoses.of(self.trajectory)


def run_odometry(
    recording: Recording,
    configuration: Configuration | None = None,
    start: float = 0.0,
    duration: float = np.inf,
) -> Run:
    """Estimate the motion from `start` for `duration` seconds; the cost includes reading.

    Raises
    ------
    InputError
        See `Odometry.run`.
    """
    meter = CostMeter()
    odometry = Odometry(recording.rig, configuration, meter.stage)
    trajectory = odometry.run(recording, start, duration)
    reports = odometry.reports
    events = sum(report.events for report in reports)
    return Run(trajectory, meter.total(reports[-1].stop - reports[0].start, events))
