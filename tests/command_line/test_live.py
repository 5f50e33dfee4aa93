"""`gpvo live` from a recording that is played: results, what is kept, and Ctrl-C."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo import Odometry, Trajectory, open_recording
from gpvo.commands.live_trajectory import UNFINISHED
from gpvo.config import load_configuration
from gpvo.recordings import Events
from gpvo.trajectory import read_tum

COMMAND = [sys.executable, "-m", "gpvo"]


def arguments(recording: RecordingFiles, output: Path, *more: str | Path) -> list[str]:
    files = [recording.data, "--calibration", recording.calibration, "--config", recording.config]
    return ["live", *map(str, [*files, "--output", output, *more])]


@pytest.fixture
def nothing_is_shed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever else the computer does."""
    for limit in ("OLD", "BUSY", "LATE"):
        monkeypatch.setattr(f"gpvo.live.load.{limit}", 60.0)
    monkeypatch.setattr("gpvo.live.session.LONGEST", 60.0)


@pytest.mark.usefixtures("nothing_is_shed")
def test_results_are_written_and_the_events_kept(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    kept, output = tmp_path / "kept.aedat4", tmp_path / "out"
    command = arguments(recording, output, "--record", kept)
    code, out, error = gpvo(*command)
    assert code == 0, error
    assert "latency" in out and "verdict" in out
    poses, trajectory = (
        read_tum(output / "trajectory.tum"),
        Trajectory.load(output / "trajectory.npz"),
    )
    assert len(poses) == len(trajectory) > 100
    first, again = open_recording(recording.data, recording.calibration), open_recording(kept)
    assert again.start_ns == first.start_ns
    for side in ("left", "right"):
        a, b = (
            Events.concatenate(getattr(batch, side) for batch in each.event_batches())
            for each in (first, again)
        )
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.polarity, b.polarity)
        np.testing.assert_allclose(a.t, b.t, atol=1e-9)

    code, _, error = gpvo(*command)
    assert code == 2 and error.startswith(f"gpvo: {kept}: exists") and error.count("\n") == 1


def wait_for(process: subprocess.Popen, file: Path) -> None:
    deadline = time.monotonic() + 120
    while not file.exists():
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)


def test_ctrl_c_ends_with_the_results_so_far(recording: RecordingFiles, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, *arguments(recording, tmp_path / "out", "--speed", "0.2")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    file = tmp_path / "out" / "trajectory.tum"
    try:
        wait_for(process, file)
        time.sleep(2.0)  # of 4 s
        unfinished = file.read_text()
        assert unfinished.startswith(f"# {UNFINISHED}\n") and unfinished.endswith("\n")
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, said
    assert "ending, results follow" in said and "Traceback" not in said
    trajectory = Trajectory.load(tmp_path / "out" / "trajectory.npz")
    assert 0.1 < trajectory.stop < open_recording(recording.data, recording.calibration).duration
    assert (tmp_path / "out" / "metrics.json").exists() and (tmp_path / "out" / "path.png").exists()


def test_a_second_ctrl_c_ends_at_once(recording: RecordingFiles, tmp_path: Path) -> None:
    code = (
        "import time; from gpvo.commands.interruption import end_at_ctrl_c\n"
        "with end_at_ctrl_c(lambda: None):\n    print('on', flush=True); time.sleep(60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert "Ctrl-C again ends at once" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 130
    finally:
        process.kill()


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("dv://127.0.0.1:1,2", "--calibration is needed for cameras"),
        ("nothing.hdf5", "nothing.hdf5: no such file"),
    ],
)
def test_bad_input_is_one_line(gpvo: Callable, source: str, message: str) -> None:
    code, _, error = gpvo("live", source)
    assert code == 2 and message in error and error.count("\n") == 1


@pytest.mark.usefixtures("nothing_is_shed")
def test_a_right_camera_that_is_late_is_corrected(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    late = tmp_path / "late.hdf5"
    shutil.copy(recording.data, late)
    with h5py.File(late, "r+") as file:
        file["davis/right/events"][:, 2] += 0.03
    moved, output = replace(recording, data=late), tmp_path / "out"
    code, _, error = gpvo(*arguments(moved, output, "--right-offset", "0.03"))
    assert code == 0 and "clocks" not in error, error
    sound = open_recording(recording.data, recording.calibration)
    expected = Odometry(sound.rig, load_configuration(recording.config)).run(sound)
    found = Trajectory.load(output / "trajectory.npz")
    t = np.linspace(max(found.start, expected.start), min(found.stop, expected.stop), 20)
    positions = [each.pose(t)[:, :3, 3] for each in (found, expected)]
    assert np.linalg.norm(positions[0] - positions[1], axis=1).max() < 0.01


def test_cameras_have_no_offset_that_is_found(recording: RecordingFiles, gpvo: Callable) -> None:
    command = ["live", "usb://1,2", "--calibration", recording.calibration]
    for offset, message in (
        ("auto", "--right-offset auto: needs a recording"),
        ("late", "--right-offset late: give seconds"),
    ):
        code, _, error = gpvo(*command, "--right-offset", offset)
        assert code == 2 and message in error and error.count("\n") == 1


def test_a_file_to_record_needs_a_known_ending(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    code, _, error = gpvo(*arguments(recording, tmp_path, "--record", tmp_path / "rr.xyz"))
    assert code == 2 and "rr.xyz: which format? let its name end with one of .hdf5" in error
    assert "--to" not in error


def test_no_time_is_refused(recording: RecordingFiles, gpvo: Callable, tmp_path: Path) -> None:
    code, _, error = gpvo(*arguments(recording, tmp_path / "out", "--duration", "0"))
    assert code == 2 and not (tmp_path / "out").exists()
    assert error == "gpvo: --duration 0: give a positive number of seconds\n"
