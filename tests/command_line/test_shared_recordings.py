"""Short runs on the shared recordings, if they are present."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpvo import Configuration, Odometry, open_recording
from gpvo.commands.result import evaluate_trajectory
from gpvo.evaluation.poses.load import load_poses

SHARED = Path(__file__).resolve().parents[3] / "shared"
CALIBRATION = SHARED / "recordings" / "camchain-imucam-indoor_flying.yaml"
pytestmark = pytest.mark.skipif(not SHARED.exists(), reason="needs ../shared, which is not here")


def test_room_is_followed_for_two_seconds() -> None:
    recording = open_recording(SHARED / "recordings" / "room1_indoor1_data.hdf5", CALIBRATION)
    truth = load_poses(SHARED / "recordings" / "room1_indoor1_gt.hdf5", recording.rig)
    fast = Configuration.model_validate({"estimator": {"state_interval": 0.01}})
    odometry = Odometry(recording.rig, fast)
    trajectory = odometry.run(recording, start=2.0, duration=2.0)
    evaluation = evaluate_trajectory(trajectory, truth)
    assert all(report.inliers >= 20 for report in odometry.reports[4:])
    assert evaluation.relative_error.statistics("se3").rms < 2.5e-3
    assert evaluation.global_error.statistics("translation").final_percent < 6.0


def test_real_events_give_the_true_mean_velocity() -> None:
    """Left events are MVSEC's, right ones are made of them; 30 degrees and 50 % are allowed."""
    folder = SHARED / "real" / "mvsec_indoor_flying1_slice"
    recording = open_recording(folder / "semi_synthetic_data.hdf5", CALIBRATION)
    trajectory = Odometry(recording.rig).run(recording)
    times = np.linspace(trajectory.start, trajectory.stop, 100)
    estimated = trajectory.velocity(times).mean(axis=0)
    rotation = recording.rig.left.R_rect
    true_angular = rotation @ [0.014, 0.155, 0.018]
    true_linear = rotation @ [0.084, -0.087, -0.092]
    for part, true in ((estimated[:3], true_angular), (estimated[3:], true_linear)):
        ratio = np.linalg.norm(part) / np.linalg.norm(true)
        cosine = part @ true / np.linalg.norm(part) / np.linalg.norm(true)
        assert 0.5 < ratio < 1.5
        assert cosine > np.cos(np.radians(30))
