"""A small simulated recording, and a configuration that is soon done with it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY))  # `benchmarks` is not installed

from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate  # noqa: E402

SMALL = SimulationConfig(
    seed=1, motion="back_and_forth", duration=0.6, resolution=(160, 120), focal_length=110.0
)


@pytest.fixture(scope="session")
def recording() -> SimulatedRecording:
    return simulate(SMALL)


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "config.yaml"
    path.write_text(
        "tracking: {klt: {max_features: 40}}\nclustering: {max_events: 5000}\n"
        "estimator: {method: batch, state_interval: 0.01}\n"
    )
    return path


@pytest.fixture
def shared_reference() -> Path:
    """Folder of reference trajectories, which is not part of the project."""
    folder = REPOSITORY.parent / "shared" / "reference"
    if not folder.is_dir():
        pytest.skip("the folder ../shared with reference trajectories is not there")
    return folder
