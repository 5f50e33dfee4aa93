"""Files that a killed run leaves."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo.commands.live_trajectory import UNFINISHED
from gpvo.trajectory import read_tum

COMMAND = [sys.executable, "-c", "from gpvo.commands.cli import main; main()"]


@pytest.mark.parametrize("method", ["fixed_lag", "batch"])
def test_killed_run_leaves_whole_lines_that_can_be_evaluated(
    recording: RecordingFiles, tmp_path: Path, method: str
) -> None:
    config = tmp_path / "config.yaml"
    config.write_text(recording.config.read_text() + f"estimator: {{method: {method}}}\n")
    arguments = RecordingFiles(**{**vars(recording), "config": config}).arguments(tmp_path / "out")
    process = subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.DEVNULL)
    file = tmp_path / "out" / "trajectory.tum"
    try:
        while process.poll() is None and not (file.exists() and len(file.read_bytes()) > 500):
            time.sleep(0.005)
    finally:
        process.kill()
    text = file.read_text()
    if process.wait() != -signal.SIGKILL:
        pytest.skip("the run had ended before it could be killed")
    if not text.startswith(f"# {UNFINISHED}\n"):
        pytest.skip("the run was writing its results when it was killed")
    assert text.endswith("\n")
    poses = read_tum(file)
    assert (np.diff(poses.stamps_ns) > 0).all()

    evaluate = ["eval", file, "--ground-truth", recording.ground_truth]
    evaluate += ["--calibration", recording.calibration]
    evaluated = subprocess.run([*COMMAND, *map(str, evaluate)], capture_output=True, text=True)
    assert evaluated.returncode == 0, evaluated.stderr
    assert "ATE" in evaluated.stdout
