"""A scene that is far for the baseline, with disparities of a pixel, is followed as any other."""

from __future__ import annotations

import numpy as np
import pytest

from gpvo import Odometry
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation import evaluate
from gpvo.evaluation.front_end.truth import truth_of_simulation
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.mapping.recorder import MeasurementRecorder
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    """Seen as a hall of 30 m, flown through at 5 m/s, is with a baseline of 0.1 m."""
    return simulate(
        SimulationConfig(
            seed=4, duration=0.6, resolution=(240, 180), focal_length=157.0, baseline=0.02
        )
    )


def test_it_is_followed(recording: SimulatedRecording) -> None:
    seen = MeasurementRecorder()
    odometry = Odometry(recording.rig, observer=seen)
    trajectory = odometry.run(recording)
    inliers = [report.inliers for report in odometry.reports if report.start > 0.2]
    assert np.median(inliers) > 60
    evaluation = evaluate(ContinuousPoses.of(trajectory), recording.ground_truth, step=0.01)
    assert evaluation.global_error.statistics("translation").final_percent < 5
    disparity = truth_of_simulation(recording).disparity(seen.measurements, odometry.camera)
    assert np.median(disparity) < 1.5
    error = seen.measurements.stereo[:, 2] - disparity
    assert abs(np.median(error)) < 0.02
    assert np.median(np.abs(error)) < 0.1


def test_it_is_not_with_the_papers_smallest_disparity(recording: SimulatedRecording) -> None:
    """Hardly a landmark is left, and the error says why."""
    configuration = Configuration.model_validate({"tracklets": {"min_disparity": 2}})
    with pytest.raises(InputError, match="too small a disparity"):
        Odometry(recording.rig, configuration).run(recording)
