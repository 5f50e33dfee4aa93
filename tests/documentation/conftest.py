"""Recording that the documentation speaks of."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gpvo.simulation import SimulationConfig, simulate
from gpvo.trajectory import write_tum


@pytest.fixture(scope="session")
def room_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulate the recording of docs/first_steps.md, under the names that all pages use."""
    folder = tmp_path_factory.mktemp("room")
    config = SimulationConfig(seed=2, duration=0.36, resolution=(240, 180), focal_length=160.0)
    simulated = simulate(config)
    simulated.write_mvsec(folder)
    (folder / f"{simulated.path}_data.hdf5").rename(folder / "room_data.hdf5")
    (folder / f"{simulated.path}_gt.hdf5").rename(folder / "room_gt.hdf5")
    (folder / f"camchain-{simulated.path}.yaml").rename(folder / "camchain.yaml")
    for name in ("esvo.txt", "esvo2.txt"):  # other odometries, without errors
        write_tum(folder / name, simulated.ground_truth)
    return folder


@pytest.fixture
def room(room_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a new folder with the recording."""
    shutil.copytree(room_files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
