"""Simulated recording on disk in MVSEC's layout, and the command in this process."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from run_files import RecordingFiles

from gpvo.commands.cli import main
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


@pytest.fixture
def gpvo(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs the command and returns exit status, stdout and stderr."""

    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["gpvo", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        code = ended.value.code
        return (code if isinstance(code, int) else 0), captured.out, captured.err

    return call
