"""`gpvo tune-noise`: noise parameters learned from a recording and its true poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
import yaml

from gpvo.commands.inputs import (
    Calibration,
    Config,
    LeftTopic,
    RightTopic,
    configured,
    load_ground_truth,
)
from gpvo.config import Configuration, NoiseConfig, in_tracked_pixels
from gpvo.errors import about
from gpvo.estimator.noise_learning import check_count, states_of_poses, tuned_noise
from gpvo.mapping.recorder import MeasurementRecorder
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.trajectory import StampedPoses


def tune_noise(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording.")],
    ground_truth: Annotated[Path, typer.Option(help="True poses.")],
    calibration: Calibration = None,
    config: Config = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Learn Q_c and R by maximum likelihood; print them as YAML for `--config`."""
    opened = open_recording(recording, calibration, left_topic, right_topic)
    truth = load_ground_truth(ground_truth, opened, calibration)
    configuration = configured(config, None)
    noise = tuned_on_recording(opened, truth, configuration, str(ground_truth))
    print(noise_text(noise), end="")


def tuned_on_recording(
    recording: Recording,
    truth: StampedPoses,
    configuration: Configuration,
    truth_name: str = "ground truth",
) -> NoiseConfig:
    """Noise parameters learned from a recording's inlier tracklets and its true poses."""
    t = np.asarray((truth.stamps_ns - recording.start_ns) * 1e-9, np.float64)
    with about(truth_name):
        check_count(t)
        motion = states_of_poses(t, truth.T_world_cam)
    seen = MeasurementRecorder()
    odometry = Odometry(recording.rig, configuration, observer=seen)
    for _ in odometry.reports_of(recording.event_batches()):
        pass
    with about(truth_name):
        noise = tuned_noise([seen.measurements], motion, odometry.camera)
    return in_tracked_pixels(noise, odometry.configuration)


def noise_text(noise: NoiseConfig) -> str:
    """YAML of the learned parameters, rounded to three digits, as part of a configuration."""
    fields = {
        name: [float(f"{value:.3g}") for value in getattr(noise, name)]
        for name in ("acceleration_psd", "measurement_information")
    }
    kept = {name: getattr(noise, name) for name in ("track_drift", "disparity_drift")}
    fixed = kept | {"motion_memory": 0.0, "measurement_memory": 0.0}
    return str(yaml.safe_dump({"noise": fields | fixed}, sort_keys=False))
