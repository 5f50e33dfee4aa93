"""Files that a killed run leaves."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo.commands.live_trajectory import UNFINISHED
from gpvo.trajectory import read_tum

COMMAND = [sys.executable, "-m", "gpvo"]


def started(recording: RecordingFiles, folder: Path) -> subprocess.Popen[str]:
    """Start a run that writes to a folder; what it says on stderr is kept."""
    return subprocess.Popen(
        [*COMMAND, *recording.arguments(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_killed_run_leaves_whole_lines_that_can_be_evaluated(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    arguments = recording.arguments(tmp_path / "out")
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

    truth = ["--ground-truth", recording.ground_truth, "--calibration", recording.calibration]
    code, out, error = gpvo("eval", file, *truth)
    assert code == 0 and "ATE" in out, error


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_run_that_is_to_end_keeps_the_results_so_far(
    recording: RecordingFiles, tmp_path: Path, number: signal.Signals, status: int
) -> None:
    process = started(recording, tmp_path / "out")
    file = tmp_path / "out" / "trajectory.tum"
    try:
        while process.poll() is None and not (file.exists() and len(file.read_bytes()) > 500):
            time.sleep(0.005)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == status, said
    assert said.count("ending, results follow") == 1 and "Traceback" not in said
    assert {"metrics.json", "trajectory.npz", "path.png"} <= {p.name for p in file.parent.iterdir()}
    assert not read_text_unfinished(file)


def read_text_unfinished(file: Path) -> bool:
    return UNFINISHED in file.read_text()


@pytest.mark.parametrize(
    ("delay", "number"), [(0.5, signal.SIGTERM), (1.5, signal.SIGINT), (3.0, signal.SIGTERM)]
)
def test_the_end_may_come_at_any_time(
    recording: RecordingFiles, tmp_path: Path, number: signal.Signals, delay: float
) -> None:
    """While packages are loaded, files opened, functions compiled or results written."""
    process = started(recording, tmp_path / "out")
    time.sleep(delay)
    process.send_signal(number)
    try:
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert "Traceback" not in said
    assert process.returncode in {0, 128 + number}, said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_end_while_handlers_change_is_none_by_the_system(number: signal.Signals) -> None:
    """From the first handler on there is no moment at which the system's own would act."""
    code = (
        "import os, signal, sys; change, changes = signal.signal, []\n"
        "def watched(signal_number, handler):\n"
        "    before = change(signal_number, handler); changes.append(handler)\n"
        f"    if len(changes) == {{}}: os.kill(os.getpid(), {int(number)}); sum(range(100))\n"
        "    return before\n"
        "signal.signal = watched; sys.argv = ['gpvo', '--version']\n"
        "from gpvo.__main__ import main; main()"
    )
    for changes in range(2, 9):
        done = subprocess.run([sys.executable, "-c", code.format(changes)], capture_output=True)
        assert done.returncode in {0, 128 + number} and b"Traceback" not in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_end_while_python_ends_is_none_by_a_signal(number: signal.Signals) -> None:
    """Python gives signals back to the system before it has ended."""
    for delay in np.linspace(0.0, 0.03, 4).tolist():
        with subprocess.Popen(
            [*COMMAND, "config"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(delay)
            process.send_signal(number)
            process.stdout.read()
        assert process.returncode in {0, 128 + number}


def test_an_end_while_a_generator_is_deleted_is_an_end() -> None:
    """Python ignores exceptions there, and would go on."""
    code = (
        "import os, signal; from gpvo.commands.interruption import end_by_exit\n"
        "def numbers():\n"
        "    try: yield 1\n"
        "    finally: os.kill(os.getpid(), signal.SIGTERM); sum(range(100))\n"
        "with end_by_exit():\n"
        "    opened = numbers(); next(opened); del opened; print('went on')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (143, "")
    assert done.stderr == "gpvo: terminated; nothing was saved\n"


def test_a_second_run_into_one_folder_is_refused(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    code = (
        "import sys, time; from gpvo.evaluation.report.result_folder import claim_folder;"
        f"claim_folder({str(tmp_path / 'out')!r}); print('claimed', flush=True); time.sleep(60)"
    )
    first = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout is not None and first.stdout.readline() == "claimed\n"
        (tmp_path / "out" / "metrics.json").write_text("of the first run")
        code, _, error = gpvo(*recording.arguments(tmp_path / "out"))
        assert code == 2 and "another run writes there" in error and error.count("\n") == 1
        assert (tmp_path / "out" / "metrics.json").read_text() == "of the first run"
    finally:
        first.kill()
