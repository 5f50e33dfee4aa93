"""`gpvo run A B C`: each recording in its own process and folder, whatever the others do."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo.commands.cli import main
from gpvo.commands.interruption import TERMINATED
from gpvo.commands.many import Outcome, read_summary
from gpvo.commands.run import run
from gpvo.errors import InputError
from gpvo.trajectory import Trajectory

NAMES = ("a", "b")


@pytest.fixture(scope="module")
def places(recording: RecordingFiles, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings with their files, and one that is none."""
    folder = tmp_path_factory.mktemp("many")
    for name in NAMES:
        shutil.copy(recording.data, folder / f"{name}.hdf5")
        shutil.copy(recording.calibration, folder / f"{name}.yaml")
        shutil.copy(recording.ground_truth, folder / f"{name}_gt.hdf5")
    shutil.copy(recording.config, folder / "config.yaml")
    (folder / "broken.hdf5").write_bytes(b"no recording")
    return folder


def run_all(places: Path, names: tuple[str, ...], output: Path, **options: object) -> int:
    """Run recordings; return the exit status."""
    with pytest.raises(BaseException) as ended:  # typer's Exit is no error of Python's
        run(
            [places / f"{name}.hdf5" for name in names],
            calibration=places / "{}.yaml",
            ground_truth=places / "{}_gt.hdf5",
            output=output,
            config=places / "config.yaml",
            plots="none",
            **{"duration": 0.4} | options,
        )
    if isinstance(ended.value, InputError):
        raise ended.value
    return ended.value.exit_code


@pytest.fixture(scope="module")
def first(places: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("results") / "first"
    (places / "broken.yaml").write_text("no calibration")
    (places / "broken_gt.hdf5").write_bytes(b"")
    assert run_all(places, ("a", "broken", "b"), output, jobs=2) == 2
    return output


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the question is which recordings are run; in processes they are for `first`."""

    def run_here(name: str, given: Sequence[str], folder: str) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["gpvo", *given])
        log = Path(folder) / f"{name}.log"
        with log.open("w") as text, redirect_stdout(text), pytest.raises(SystemExit) as ended:
            main()
        return Outcome(name, ended.value.code or 0, "")

    monkeypatch.setattr("gpvo.commands.many.run_one", run_here)


def states(output: Path, name: str) -> np.ndarray:
    return Trajectory.load(output / name / "trajectory.npz").T_world_cam


def test_one_that_fails_stops_no_other(first: Path) -> None:
    outcomes = read_summary(first)
    assert {name: each.status for name, each in outcomes.items()} == {"a": 0, "b": 0, "broken": 2}
    assert "broken" in outcomes["broken"].said
    np.testing.assert_array_equal(states(first, "a"), states(first, "b"))
    errors = json.loads((first / "a" / "metrics.json").read_text())["errors"]
    assert errors["ate"]["se3"]["translation"]["rmse"] < 0.1


@pytest.mark.usefixtures("in_this_process")
def test_a_second_start_runs_what_is_not_finished(
    places: Path, first: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finished, before = first / "a" / "metrics.json", states(first, "b")
    written = finished.stat().st_mtime_ns
    (first / "b" / "cost.json").unlink()
    assert run_all(places, NAMES, first) == 0
    assert finished.stat().st_mtime_ns == written
    np.testing.assert_array_equal(states(first, "b"), before)
    text = capsys.readouterr().out
    assert "a: finished by an earlier start" in text and "b: finished" not in text
    assert "verdict" in text and "good" in text


@pytest.mark.usefixtures("in_this_process")
def test_another_configuration_is_run_anew(places: Path, first: Path, tmp_path: Path) -> None:
    output = tmp_path / "copy"
    shutil.copytree(first, output)
    assert run_all(places, NAMES, output, duration=0.3) == 0
    for name in NAMES:
        assert Trajectory.load(output / name / "trajectory.npz").stop < 0.35


def test_a_worker_that_is_killed_loses_no_recording(places: Path, first: Path) -> None:
    distributed = pytest.importorskip("distributed")
    output = first.with_name("cluster")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        killer = Thread(target=kill_one, args=(cluster, output))
        killer.start()
        status = run_all(places, NAMES, output, scheduler=cluster.scheduler_address)
        killer.join()
    assert status == 0
    for name in NAMES:
        np.testing.assert_array_equal(states(output, name), states(first, name))


def kill_one(cluster: object, output: Path) -> None:
    """Kill a worker once both recordings are being run."""
    while not all((output / name / "trajectory.tum").exists() for name in NAMES):
        time.sleep(0.01)
    worker = next(iter(cluster.workers.values()))
    os.kill(worker.pid, signal.SIGKILL)


def test_a_run_ends_with_the_process_that_started_it(places: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gpvo.commands.one_of_many", "run", str(places / "a.hdf5")]
    options = [f"--calibration={places / 'a.yaml'}", f"--output={tmp_path / 'a'}"]
    with subprocess.Popen([*command, *options], stdin=subprocess.PIPE) as process:
        while not (tmp_path / "a" / "trajectory.tum").exists():
            time.sleep(0.01)
        process.stdin.close()
        assert process.wait(timeout=60) == TERMINATED
    assert not (tmp_path / "a" / "metrics.json").exists()


def test_what_is_for_one_recording_is_refused(places: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--video: is for one recording"):
        run_all(places, NAMES, tmp_path, video=tmp_path / "tracks.mp4")
    with pytest.raises(InputError, match="a: 2 recordings have this name"):
        run_all(places, ("a", "a"), tmp_path)
    (tmp_path / "summary.json").write_text("[]")
    with pytest.raises(InputError, match="is not what `gpvo run` wrote"):
        run_all(places, NAMES, tmp_path)
    pytest.importorskip("distributed")
    for names in (NAMES, NAMES[:1]):  # one recording is not run here instead
        with pytest.raises(InputError, match="cannot be reached"):
            run_all(places, names, tmp_path / f"new{len(names)}", scheduler="nowhere")
