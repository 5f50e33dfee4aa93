"""`gpvo run` from files to files."""

from __future__ import annotations

import errno
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import yaml
from run_files import RecordingFiles

from gpvo import Configuration, FixedLagSmoother, Odometry, Trajectory, open_recording
from gpvo.commands.cli import main
from gpvo.commands.result import Result
from gpvo.config import for_camera, load_configuration
from gpvo.errors import InputError
from gpvo.recordings import StereoEvents
from gpvo.recordings.files.mvsec import MvsecRecording
from gpvo.trajectory import read_tum

FILES = {
    "config.yaml",
    "error.png",
    "ground_truth.tum",
    "map.npz",
    "map.ply",
    "metrics.json",
    "overview.png",
    "path.png",
    "tracklets.png",
    "trajectory.npz",
    "trajectory.tum",
}


@pytest.fixture(scope="module")
def result(recording: RecordingFiles, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the result folder of one run."""
    folder = tmp_path_factory.mktemp("result") / "first"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gpvo", *recording.arguments(folder)])
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code
    return folder


def test_all_files_are_written(result: Path) -> None:
    assert {path.name for path in result.iterdir()} == {*FILES, "cost.json", "run.json"}
    for picture in result.glob("*.png"):
        assert cv2.imread(str(picture)) is not None


def test_second_run_writes_the_same_bytes(
    recording: RecordingFiles, result: Path, tmp_path: Path, gpvo: Callable
) -> None:
    code, out, _ = gpvo(*recording.arguments(tmp_path / "second"))
    assert code == 0
    assert "final" in out and "ATE" in out and "real time" in out
    # Where there is no terminal, progress is a few lines.
    assert (
        5 < sum("tracklets, " in line and " of 0.80 s: " in line for line in out.splitlines()) < 25
    )
    for name in FILES:
        assert (tmp_path / "second" / name).read_bytes() == (result / name).read_bytes(), name


def test_a_run_can_be_repeated_from_its_folder(
    result: Path, gpvo: Callable, tmp_path: Path
) -> None:
    code, _, _ = gpvo("run", "--repeat", result, "--output", tmp_path / "again", "--plots", "svg")
    assert code == 0
    again = {path.name for path in (tmp_path / "again").iterdir()}
    assert {"path.svg", "error.svg", "tracklets.svg", "run.json"} < again
    for name in ("trajectory.npz", "trajectory.tum", "config.yaml", "metrics.json"):
        assert (tmp_path / "again" / name).read_bytes() == (result / name).read_bytes(), name


def test_what_a_run_was_made_from_is_written(recording: RecordingFiles, result: Path) -> None:
    facts = json.loads((result / "run.json").read_text())
    assert facts["command"][:2] == ["gpvo", "run"] and facts["machine"]["packages"]["gpvo"]
    size = recording.data.stat().st_size
    assert facts["files"]["recording"]["bytes"] == size
    assert set(facts["files"]) == {"recording", "calibration", "ground_truth"}
    assert facts["request"]["duration"] is None and facts["configuration"]["seed"] == 0


def test_a_run_of_another_recording_is_not_repeated(
    result: Path, gpvo: Callable, tmp_path: Path
) -> None:
    facts = json.loads((result / "run.json").read_text())
    facts["files"]["recording"]["bytes"] += 1
    (tmp_path / "run.json").write_text(json.dumps(facts))
    code, _, error = gpvo("run", "--repeat", tmp_path)
    assert code == 2 and "is not the one of that run" in error and error.count("\n") == 1
    (tmp_path / "run.json").write_text("{}")
    code, _, error = gpvo("run", "--repeat", tmp_path)
    assert code == 2 and "is not what `gpvo run` wrote" in error and error.count("\n") == 1


def test_a_right_camera_that_is_late_is_corrected(
    recording: RecordingFiles, result: Path, gpvo: Callable, tmp_path: Path
) -> None:
    late = tmp_path / "late.hdf5"
    shutil.copy(recording.data, late)
    with h5py.File(late, "r+") as file:
        file["davis/right/events"][:, 2] += 0.03
    moved = replace(recording, data=late)
    code, out, _ = gpvo(
        *moved.arguments(tmp_path / "out"), "--right-offset", "0.03", "--plots", "none"
    )
    assert code == 0 and "degraded" not in out
    final, expected = (
        json.loads((folder / "metrics.json").read_text())["errors"]["relative_error"]["se3"]["rms"]
        for folder in (tmp_path / "out", result)
    )
    assert final < 1.5 * expected
    code, _, error = gpvo(*moved.arguments(tmp_path / "out"), "--right-offset", "late")
    assert code == 2 and "--right-offset late: give seconds, or auto" in error


def test_a_full_disk_is_one_line_that_says_what_is_saved(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "f"))

    with monkeypatch.context() as patch:
        patch.setattr(Result, "write", full)
        code, _, error = gpvo(*recording.arguments(tmp_path / "out"), "--duration", "0.3")
    assert code == 4 and error.splitlines()[-1].startswith("gpvo: ") and "Traceback" not in error
    assert "No space left on device); the whole trajectory is saved in" in error
    with monkeypatch.context() as patch:
        patch.setattr("gpvo.commands.run_and_write.save_trajectory", full)
        code, _, error = gpvo(*recording.arguments(tmp_path / "out"))
    assert code == 4 and "poses are saved in" in error and "trajectory.tum" in error
    read_tum(tmp_path / "out" / "trajectory.tum")


def test_python_gives_the_same_trajectory(recording: RecordingFiles, result: Path) -> None:
    opened = open_recording(recording.data, recording.calibration)
    trajectory = Odometry(opened.rig, load_configuration(recording.config)).run(opened)
    saved = Trajectory.load(result / "trajectory.npz")
    assert np.array_equal(saved.t, trajectory.t)
    assert np.array_equal(saved.T_world_cam, trajectory.T_world_cam)
    assert np.array_equal(saved.knot_covariance, trajectory.knot_covariance)


def test_estimator_of_your_own_takes_the_place_of_the_configured_one(
    recording: RecordingFiles, result: Path
) -> None:
    opened, config = (
        open_recording(recording.data, recording.calibration),
        load_configuration(recording.config),
    )
    camera = Odometry(opened.rig, config).camera
    mine = FixedLagSmoother(camera, config.noise, config.estimator)
    odometry = Odometry(opened.rig, config, estimator=mine)
    trajectory = odometry.run(opened)
    assert odometry.estimator is mine
    assert np.array_equal(Trajectory.load(result / "trajectory.npz").twist, trajectory.twist)


def test_diagnostics_are_in_the_metrics(result: Path) -> None:
    metrics = json.loads((result / "metrics.json").read_text())
    assert set(metrics) == {"run", "errors", "streams", "diagnostics"}
    assert metrics["streams"]["left_events_per_s"] > 1000 and metrics["streams"]["read"] == {}
    for found in metrics["diagnostics"]:
        assert set(found) == {"key", "t", "measurement", "reason"}


def test_trajectory_follows_the_true_motion(result: Path) -> None:
    metrics = json.loads((result / "metrics.json").read_text())
    assert metrics["run"]["clusters_without_inliers"] <= 2
    assert metrics["errors"]["coverage"] > 0.8
    translation = metrics["errors"]["global_error"]["translation"]
    assert translation["final_percent"] < 5


def test_tum_file_has_absolute_stamps_from_the_first_pose_on(
    recording: RecordingFiles, result: Path
) -> None:
    poses, trajectory = (
        read_tum(result / "trajectory.tum"),
        Trajectory.load(result / "trajectory.npz"),
    )
    assert np.array_equal(poses.stamps_ns, trajectory.stamps_ns(trajectory.t))
    assert trajectory.start_ns == open_recording(recording.data, recording.calibration).start_ns
    assert np.allclose(poses.T_world_cam[0], np.eye(4), atol=1e-9)


def test_configuration_of_the_run_is_kept(
    recording: RecordingFiles, result: Path, gpvo: Callable, tmp_path: Path
) -> None:
    written = load_configuration(result / "config.yaml")
    rig = open_recording(recording.data, recording.calibration).rig
    given = load_configuration(recording.config)
    assert written == for_camera(given, rig.left.resolution, rig.focal_length)
    assert written.tracking.resolutions == (1,)
    short = ["--duration", "0.3", "--seed", "7", "--plots", "none"]
    code, *_ = gpvo(*recording.arguments(tmp_path / "short"), *short)
    assert code == 0
    assert load_configuration(tmp_path / "short" / "config.yaml").seed == 7
    part = Trajectory.load(tmp_path / "short" / "trajectory.npz")
    assert part.stop <= 0.3


def test_start_and_duration_choose_a_part(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    span = ["--start", "0.3", "--duration", "0.3", "--plots", "none"]
    code, *_ = gpvo(*recording.arguments(tmp_path / "part"), *span)
    part = Trajectory.load(tmp_path / "part" / "trajectory.npz")
    assert code == 0
    assert part.start >= 0.3
    assert part.stop <= 0.6


def test_without_ground_truth_there_is_a_trajectory_and_no_error(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    common = ["--config", recording.config, "--calibration", recording.calibration]
    code, *_ = gpvo("run", recording.data, *common, "--output", tmp_path, "--duration", "0.3")
    assert code == 0
    assert json.loads((tmp_path / "metrics.json").read_text())["errors"] is None
    assert not (tmp_path / "error.png").exists()


def later_truth(recording: RecordingFiles, path: Path, begin: float) -> Path:
    """Write true poses, at rest, of a minute that begins so many seconds after the recording."""
    start_ns = open_recording(recording.data, recording.calibration).start_ns
    stamps = (start_ns * 1e-9 + begin + second for second in (0, 30, 60))
    path.write_text("".join(f"{stamp:.6f} 0 0 0 0 0 0 1\n" for stamp in stamps))
    return path


def test_a_run_keeps_its_results_where_the_truth_cannot_be_compared(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path
) -> None:
    truth = later_truth(recording, tmp_path / "late[1].tum", 0.2999)
    files = replace(recording, ground_truth=truth)
    folder = tmp_path / "out[" / "b]"
    code, out, _ = gpvo(*files.arguments(folder), "--duration", "0.3")
    assert code == 0 and out.count("late[1].tum: the errors are left out: nothing to compare") == 1
    assert f"results:{folder}" in "".join(out.split())
    assert json.loads((folder / "metrics.json").read_text())["errors"] is None
    written = {path.name for path in folder.iterdir()}
    assert {*FILES, "cost.json", "run.json"} - written == {"error.png"}


def test_mostly_dead_reckoning_is_said_and_is_exit_status_3(
    gpvo: Callable, recording: RecordingFiles, result: Path, tmp_path: Path
) -> None:
    """The right camera dies after a fifth of the recording; one event at the end remains."""
    dying = tmp_path / "dying.hdf5"
    dying.write_bytes(recording.data.read_bytes())
    with h5py.File(dying, "r+") as file:
        events = file["davis/right/events"][:]
        del file["davis/right/events"]
        file["davis/right/events"] = np.concatenate([events[: len(events) // 5], events[-1:]])
    files = replace(recording, data=dying)
    code, out, _ = gpvo(*files.arguments(tmp_path / "dead"), "--plots", "none")
    verdicts = [
        json.loads((folder / "metrics.json").read_text())["run"]["verdict"]
        for folder in (tmp_path / "dead", result)
    ]
    assert (code, verdicts) == (3, ["failed", "good"])
    assert "of the time is dead reckoning" in out
    assert (tmp_path / "dead" / "trajectory.npz").exists()


def test_trajectory_is_there_when_the_plots_fail(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full_disk(*_: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(Result, "_write_plots", full_disk)
    code, _, error = gpvo(*recording.arguments(tmp_path / "full"), "--duration", "0.3")
    assert code == 4 and "No space left on device" in error
    saved = Trajectory.load(tmp_path / "full" / "trajectory.npz")
    lines = (tmp_path / "full" / "trajectory.tum").read_text().splitlines()
    assert len(lines) == len(saved)


@pytest.mark.parametrize("preset", ["auto", "paper"])
def test_configuration_of_a_preset_is_printed_and_read_back(
    gpvo: Callable, tmp_path: Path, preset: str
) -> None:
    code, out, _ = gpvo("config", *(() if preset == "auto" else ("--preset", preset)))
    assert code == 0
    (tmp_path / "config.yaml").write_text(out)
    configuration = Configuration.model_validate({"preset": preset})
    assert load_configuration(tmp_path / "config.yaml") == configuration
    values = yaml.safe_load(out)
    assert values["preset"] == preset
    assert values["noise"]["acceleration_psd"][:3] == [0.002] * 3
    information = {"auto": [4, 4, 7], "paper": [0.5, 0.5, 0.1]}[preset]
    assert values["noise"]["measurement_information"] == information


def test_preset_that_is_none_is_an_error_with_those_that_are(gpvo: Callable) -> None:
    code, _, error = gpvo("config", "--preset", "esvo")
    assert code == 2
    assert "auto" in error and "paper" in error


class TestBadInput:
    """Bad input gives one clear line, exit status 2, and no file that looks like a result."""

    @pytest.fixture
    def fails(
        self, recording: RecordingFiles, gpvo: Callable, tmp_path: Path
    ) -> Callable[..., None]:
        def check(expected: str, *options: str | Path, **files: Path) -> None:
            changed = RecordingFiles(**{**vars(recording), **files})
            code, _, error = gpvo(*changed.arguments(tmp_path / "out"), *options)
            assert code == 2, error
            assert error.count("\n") == 1, error
            assert expected in error, error
            assert not list((tmp_path / "out").glob("*"))

        return check

    def edited(
        self, recording: RecordingFiles, tmp_path: Path, edit: Callable[[h5py.File], None]
    ) -> Path:
        path = tmp_path / "edited.hdf5"
        path.write_bytes(recording.data.read_bytes())
        with h5py.File(path, "r+") as file:
            edit(file)
        return path

    def test_missing_file(self, fails: Callable, tmp_path: Path) -> None:
        fails("nowhere.hdf5", data=tmp_path / "nowhere.hdf5")

    def test_missing_calibration(self, fails: Callable, tmp_path: Path) -> None:
        fails("nowhere.yaml", calibration=tmp_path / "nowhere.yaml")

    def test_missing_ground_truth(self, fails: Callable, tmp_path: Path) -> None:
        fails("nowhere.tum", ground_truth=tmp_path / "nowhere.tum")

    def test_missing_configuration(self, fails: Callable, tmp_path: Path) -> None:
        fails("nowhere.yaml", config=tmp_path / "nowhere.yaml")

    @pytest.mark.parametrize("part", [0.1, 0.5, 0.9])
    def test_truncated_file(
        self, fails: Callable, recording: RecordingFiles, tmp_path: Path, part: float
    ) -> None:
        content = recording.data.read_bytes()
        path = tmp_path / "truncated.hdf5"
        path.write_bytes(content[: int(part * len(content))])
        fails("truncated.hdf5", data=path)

    def test_empty_stream(self, fails: Callable, recording: RecordingFiles, tmp_path: Path) -> None:
        def empty(file: h5py.File) -> None:
            del file["davis/left/events"]
            file["davis/left/events"] = np.empty((0, 4))

        fails("davis/left/events", data=self.edited(recording, tmp_path, empty))

    def test_missing_right_camera(
        self, fails: Callable, recording: RecordingFiles, tmp_path: Path
    ) -> None:
        def remove(file: h5py.File) -> None:
            del file["davis/right"]

        fails("davis/right", data=self.edited(recording, tmp_path, remove))

    @pytest.mark.parametrize("resolution", [[120, 90], [480, 360]])
    def test_calibration_of_another_resolution(
        self, fails: Callable, recording: RecordingFiles, tmp_path: Path, resolution: list[int]
    ) -> None:
        chain = yaml.safe_load(recording.calibration.read_text())
        for camera in chain.values():
            camera["resolution"] = resolution
        path = tmp_path / "other.yaml"
        path.write_text(yaml.safe_dump(chain))
        fails("calibration of this camera's resolution", calibration=path)

    @pytest.mark.parametrize(("row", "time"), [(5000, np.nan), (5000, 0.0), (-1, np.inf)])
    def test_times_that_are_no_times(
        self,
        fails: Callable,
        recording: RecordingFiles,
        tmp_path: Path,
        row: int,
        time: float,
    ) -> None:
        def spoil(file: h5py.File) -> None:
            file["davis/left/events"][row, 2] = time

        fails("davis/left/events", data=self.edited(recording, tmp_path, spoil))

    def test_start_beyond_the_end(self, fails: Callable) -> None:
        fails("--start", "--start", "100")

    def test_ground_truth_of_another_time(self, fails: Callable, tmp_path: Path) -> None:
        path = tmp_path / "other.tum"
        path.write_text("5 0 0 0 0 0 0 1\n6 0 0 0 0 0 0 1\n")
        fails("other.tum", ground_truth=path)

    @pytest.mark.parametrize("span", [("--duration", "0.3"), ("--start", "0.2")])
    def test_ground_truth_of_another_part(
        self, recording: RecordingFiles, fails: Callable, tmp_path: Path, span: tuple[str, str]
    ) -> None:
        begin = 0.4 if span[0] == "--duration" else -59.9
        truth = later_truth(recording, tmp_path / "part.tum", begin)
        fails("part.tum: its poses, from ", *span, ground_truth=truth)

    @pytest.mark.parametrize(
        ("text", "field"),
        [
            ("estimator: {windw: 3}", "estimator.windw"),
            ("estimator: {window: many}", "estimator.window"),
            ("clustering: {max_events: -1}", "clustering.max_events"),
            ("clustering: {max_thickness: 2.2}", "clustering.max_thickness"),
            ("preset: esvo", "preset: Input should be 'auto' or 'paper'"),
            ("[1, 2]", "config.yaml"),
            ("a: [", "config.yaml"),
            ("estimator: {method: gauss_newton}", "method: fixed_lag"),
            ("estimator: {loss: gnc}", "geman_mcclure"),
            ("estimator: {landmarks: variables}", "fixed_lag eliminates landmarks"),
            ("estimator: {method: isam2}", "estimator.method"),
            ("tracking: {tracker: event}", "tracker: klt"),
            ("tracking: {event: {patch_size: 31}}", "tracker: klt"),
            ("noise: {track_drift: -1}", "noise.track_drift"),
        ],
    )
    def test_configuration(self, fails: Callable, tmp_path: Path, text: str, field: str) -> None:
        path = tmp_path / "config.yaml"
        path.write_text(text)
        fails(field, config=path)

    def test_earlier_result_does_not_stay_when_a_later_event_is_faulty(
        self,
        recording: RecordingFiles,
        gpvo: Callable,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        batches = MvsecRecording.event_batches

        def interrupted(self: MvsecRecording, *interval: float) -> Iterator[StereoEvents]:
            for batch in batches(self, *interval):
                if interval and batch.start > 0.3:
                    raise InputError("row 9: time goes backwards")
                yield batch

        monkeypatch.setattr(MvsecRecording, "event_batches", interrupted)
        (tmp_path / "trajectory.tum").write_text("1 0 0 0 0 0 0 1\n")
        code, _, error = gpvo(*recording.arguments(tmp_path))
        assert code == 2
        assert "row 9" in error
        assert not list(tmp_path.glob("*"))

    def test_output_that_is_a_file(
        self, recording: RecordingFiles, gpvo: Callable, tmp_path: Path
    ) -> None:
        (tmp_path / "out").write_text("")
        code, _, error = gpvo(*recording.arguments(tmp_path / "out"))
        assert code == 2
        assert str(tmp_path / "out") in error
