"""Simulated recording on disk in MVSEC's layout, for `gpvo run`."""

from __future__ import annotations

import pytest
from run_files import RecordingFiles

from gpvo.simulation import SimulationConfig, simulate

NAME = "simulated_hand_held_2"


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> RecordingFiles:
    folder = tmp_path_factory.mktemp("recording")
    config = SimulationConfig(seed=2, duration=0.8, resolution=(240, 180), focal_length=160.0)
    simulated = simulate(config)
    simulated.write_mvsec(folder)
    (folder / "config.yaml").write_text(
        "tracking: {klt: {max_features: 80}}\nclustering: {max_events: 10000}\n"
    )
    return RecordingFiles(
        folder / f"{NAME}_data.hdf5",
        folder / f"camchain-{NAME}.yaml",
        folder / f"{NAME}_gt.hdf5",
        folder / "config.yaml",
    )
