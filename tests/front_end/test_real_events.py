"""Real left events of MVSEC indoor_flying1: the velocity is that of the motion capture.

The right events are semi-synthetic, made from the left ones and measured depth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpvo import Odometry, open_recording
from gpvo.config import ClusteringConfig, Configuration, TrackletConfig

SHARED = Path(__file__).resolve().parents[3] / "shared"
SLICE = SHARED / "real" / "mvsec_indoor_flying1_slice" / "semi_synthetic_data.hdf5"
CALIBRATION = SHARED / "recordings" / "camchain-imucam-indoor_flying.yaml"
ANGULAR, LINEAR = (0.014, 0.155, 0.018), (0.084, -0.087, -0.092)
"""Near the middle, rad/s and m/s, as the data's description gives them."""


@pytest.mark.skipif(not SLICE.exists(), reason=f"needs {SLICE.name} of the shared data")
def test_velocity_of_real_events() -> None:
    """Slow motion and few events: short clusters, and tracklets from a pixel on."""
    configuration = Configuration(
        clustering=ClusteringConfig(window=0.05), tracklets=TrackletConfig(min_length=1.0)
    )
    recording = open_recording(SLICE, CALIBRATION)
    trajectory = Odometry(recording.rig, configuration).run(recording)
    middle = [trajectory.velocity(t) for t in np.linspace(0.05, 0.19, 29)]
    velocity = np.mean(middle, axis=0)
    assert np.linalg.norm(velocity[:3] - ANGULAR) < 0.03
    assert np.linalg.norm(velocity[3:] - LINEAR) < 0.05
