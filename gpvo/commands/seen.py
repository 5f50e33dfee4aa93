"""What every run keeps for its results: a picture of the tracks, and what the map is made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpvo.commands.found_noise import NoiseHistory
from gpvo.evaluation import Evaluation
from gpvo.mapping import LandmarkMap, MeasurementRecorder, triangulate
from gpvo.observer import Step
from gpvo.odometry import Odometry
from gpvo.trajectory import Trajectory
from gpvo.view.keeper import BestPicture


class Seen:
    """Observer of a run.

    Attributes
    ----------
    noise
        What was found of the noise.
    """

    def __init__(self) -> None:
        self.noise = NoiseHistory()
        self._best, self._measured = BestPicture(), MeasurementRecorder()

    def __call__(self, step: Step) -> None:
        """Look at one more cluster."""
        self._best(step)
        self._measured(step)
        self.noise(step)

    def write(
        self,
        folder: Path,
        odometry: Odometry,
        trajectory: Trajectory,
        evaluation: Evaluation | None,
        plots: str = "png",
    ) -> LandmarkMap:
        """Write map.npz, map.ply and the overview, unless `plots` is none; return the map."""
        information = np.array(odometry.measurement_information)
        measurements = self._measured.measurements
        found = triangulate(trajectory, measurements, odometry.camera, information)
        found.save(folder / "map.npz")
        found.write_ply(folder / "map.ply")
        if plots != "none":
            # matplotlib is slow to import
            from gpvo.evaluation.report.figures import save_figure
            from gpvo.view.overview import overview_figure

            figure = overview_figure(trajectory, self._best, evaluation)
            save_figure(figure, folder / f"overview.{plots}")
        return found
