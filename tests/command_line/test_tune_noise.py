"""`gpvo tune-noise` from files to a configuration that `gpvo run` takes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo import open_recording
from gpvo.commands.cli import main
from gpvo.commands.inputs import load_ground_truth
from gpvo.config import load_configuration
from gpvo.estimator.noise_learning import acceleration_psd


def tune_noise(*arguments: str | Path) -> int:
    """Run the command and return its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gpvo", "tune-noise", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
    return ended.value.code if isinstance(ended.value.code, int) else 0


def test_learned_noise_is_a_configuration(
    recording: RecordingFiles, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--ground-truth", recording.ground_truth, "--calibration", recording.calibration]
    assert tune_noise(recording.data, *files, "--config", recording.config) == 0
    learned = tmp_path / "noise.yaml"
    learned.write_text(capsys.readouterr().out)
    noise = load_configuration(learned).noise
    opened = open_recording(recording.data, recording.calibration)
    truth = load_ground_truth(recording.ground_truth, opened, recording.calibration)
    t = (truth.stamps_ns - opened.start_ns) * 1e-9
    assert np.allclose(noise.acceleration_psd, acceleration_psd(t, truth.T_world_cam), rtol=0.01)
    deviation = 1 / np.sqrt(np.array(noise.measurement_information))
    assert ((deviation > 0.05) & (deviation < 5)).all()  # pixels; tracking has some noise


def test_ground_truth_that_is_missing_is_one_clear_error(
    recording: RecordingFiles, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "missing.hdf5"
    files = ["--ground-truth", missing, "--calibration", recording.calibration]
    assert tune_noise(recording.data, *files) != 0
    assert str(missing) in capsys.readouterr().err


def test_ground_truth_of_two_poses_is_named(
    recording: RecordingFiles, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = tmp_path / "few.tum"
    begin = open_recording(recording.data, recording.calibration).start_ns * 1e-9
    few.write_text("".join(f"{begin + t:.6f} 0 0 0 0 0 0 1\n" for t in (0, 1)))
    files = ["--ground-truth", few, "--calibration", recording.calibration]
    assert tune_noise(recording.data, *files) == 2
    assert f"{few}: 2 poses: the ground truth needs three" in capsys.readouterr().err
