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
from gpvo.config import Configuration, NoiseConfig
from gpvo.estimator import Repair
from gpvo.estimator.noise_learning import states_of_poses, tuned_noise
from gpvo.events import cluster_events
from gpvo.mc_ransac import VelocityFit
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.tracking import Measurements
from gpvo.trajectory import StampedPoses, States


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
    print(noise_text(tuned_on_recording(opened, truth, configuration)), end="")


def tuned_on_recording(
    recording: Recording, truth: StampedPoses, configuration: Configuration
) -> NoiseConfig:
    """Noise parameters learned from a recording's inlier tracklets and its true poses."""
    odometry, recorder = Odometry(recording.rig, configuration), _Recorder()
    odometry.estimator = recorder
    batches = recording.event_batches()
    for cluster in cluster_events(batches, recording.rig, configuration.clustering):
        odometry.process(cluster)
    t = np.asarray((truth.stamps_ns - recording.start_ns) * 1e-9, np.float64)
    return tuned_noise(recorder.clusters, states_of_poses(t, truth.T_world_cam), odometry.camera)


def noise_text(noise: NoiseConfig) -> str:
    """YAML of the learned parameters, rounded to three digits, as part of a configuration."""
    fields = {
        name: [float(f"{value:.3g}") for value in getattr(noise, name)]
        for name in ("acceleration_psd", "measurement_information")
    }
    return str(yaml.safe_dump({"noise": fields}, sort_keys=False))


class _Recorder:
    """An estimator that only remembers its measurements."""

    def __init__(self) -> None:
        self.repairs: list[Repair] = []
        self.clusters: list[Measurements] = []

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> States:
        """Remember a cluster's measurements."""
        self.clusters.append(measurements)
        return States()

    def settled(self, after: float) -> States:
        """There are none."""
        return States()

    def trajectory(self, start_ns: int) -> None:
        """There is none."""
