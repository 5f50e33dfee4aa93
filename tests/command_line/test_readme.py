"""Commands, code and file names of the README."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from run_files import RecordingFiles

from gpvo import Configuration
from gpvo.commands.cli import main
from gpvo.trajectory import read_tum

REPOSITORY = Path(__file__).resolve().parents[2]
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.fixture
def room(recording: RecordingFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a folder with the files that the README mentions, and change to it."""
    shutil.copy(recording.data, tmp_path / "room_data.hdf5")
    shutil.copy(recording.calibration, tmp_path / "camchain.yaml")
    shutil.copy(recording.ground_truth, tmp_path / "room_gt.hdf5")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", shlex.split(command))
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code, command


def test_commands_of_the_readme(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    commands = [line for line in lines if line.startswith("gpvo ")]
    assert len(commands) >= 3
    for command in commands:
        call(command, monkeypatch)
    named = set(re.findall(r"`([a-z]+\.(?:tum|npz|json|yaml|png))`", README))
    assert named <= {path.name for path in (room / "results" / "room").iterdir()}


def test_first_command_ends_in_the_demo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = next(line for block in blocks("sh") for line in block.splitlines())
    assert first.endswith("gpvo demo")
    monkeypatch.chdir(tmp_path)
    call("gpvo demo", monkeypatch)
    assert (tmp_path / "results" / "demo" / "path.png").exists()
    assert "final %" in capsys.readouterr().out


def test_python_of_the_readme(room: Path) -> None:
    (program,) = blocks("python")
    assert len([line for line in program.splitlines() if line]) == 5
    names: dict = {}
    exec(program, names)
    poses = read_tum(room / "trajectory.tum")
    trajectory = names["trajectory"]
    assert np.array_equal(poses.stamps_ns, trajectory.stamps_ns(trajectory.t))


def test_configuration_of_the_readme() -> None:
    for block in blocks("yaml"):
        Configuration.model_validate(yaml.safe_load(block))
    for text in re.findall(r"`([a-z_.]+: [^`]+)`", README):
        *path, leaf = text.partition(":")[0].split(".")
        value = yaml.safe_load(text.partition(":")[2])
        content = {leaf: value}
        for name in reversed(path):
            content = {name: content}
        Configuration.model_validate(content)


def test_files_of_the_readme_exist() -> None:
    for name in re.findall(r"`(gpvo/[a-z_/]+(?:\.py)?)`", README):
        assert (REPOSITORY / name).exists(), name
    for name in re.findall(r"\]\(([a-z_/]+\.png)\)", README):
        assert (REPOSITORY / name).exists(), name
