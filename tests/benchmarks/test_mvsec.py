"""The MVSEC benchmark from files in MVSEC's layout to the tables, the report and the costs."""

from __future__ import annotations

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks.mvsec import CALIBRATION, SPANS_NS, main
from gpvo.errors import InputError
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.simulation import SimulatedRecording
from gpvo.trajectory import StampedPoses, Trajectory, write_tum

NAME = "indoor_flying1"


def moved_to(start_ns: int, recording: SimulatedRecording) -> SimulatedRecording:
    """The recording at another time of the world's clock."""
    later_ns = start_ns - recording.start_ns
    truth = recording.ground_truth
    return replace(
        recording,
        path=Path(NAME),
        start_ns=start_ns,
        ground_truth=StampedPoses(truth.stamps_ns + later_ns, truth.T_world_cam),
    )


@pytest.fixture
def data(recording: SimulatedRecording, tmp_path: Path) -> Path:
    """A folder like MVSEC's, with others' trajectories beside it."""
    early = moved_to(SPANS_NS[NAME][0] - 100_000_000, recording)
    early.write_mvsec(tmp_path / "mvsec" / "indoor_flying")
    (tmp_path / "mvsec" / "calib").mkdir()
    camchain = tmp_path / "mvsec" / "indoor_flying" / f"camchain-{NAME}.yaml"
    camchain.rename(tmp_path / "mvsec" / "calib" / CALIBRATION)
    others = tmp_path / "others" / f"mvsec_{NAME}"
    others.mkdir(parents=True)
    truth = early.ground_truth.between(SPANS_NS[NAME][0], SPANS_NS[NAME][0] + 300_000_000)
    write_tum(others / "esvo2.txt", truth[::3])
    write_tum(others / "esvo2_groundtruth.txt", truth)
    return tmp_path


def test_one_table_from_files_in_mvsecs_layout(data: Path, config_file: Path) -> None:
    text = StringIO()
    options = ["--data", data / "mvsec", "--sequences", NAME, "--trajectories", data / "others"]
    options += ["--config", config_file, "--output", data / "report"]
    (outcome,) = main(list(map(str, options)), Console(file=text, width=120))

    ours, esvo2 = outcome.comparison.evaluations
    assert (ours.name, esvo2.name) == ("gpvo", "esvo2")
    assert np.isin(ours.estimate.stamps_ns, esvo2.estimate.stamps_ns).all()
    assert len(ours.estimate) >= 15
    assert ours.global_error.statistics("translation").final_percent < 20.0
    start_ns = SPANS_NS[NAME][0] - 100_000_000
    assert abs(outcome.run.trajectory.start_ns - start_ns) < 1000  # MVSEC's float64 seconds
    assert outcome.run.trajectory.start >= 0.1

    rows = text.getvalue()
    for word in ("GPCT (published)", "ESVO (published)", "0.635", "7.90e-3", "esvo2", "tracking"):
        assert word in rows
    check_output(data / "report", outcome.run.poses)


def test_a_dask_cluster_gives_the_same_as_this_process(data: Path, config_file: Path) -> None:
    distributed = pytest.importorskip("distributed")
    options = ["--data", data / "mvsec", "--sequences", NAME, "--config", config_file]
    console = Console(file=StringIO())
    (here,) = main(list(map(str, options)), console)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        there = main(list(map(str, [*options, "--scheduler", cluster.scheduler_address])), console)
    poses = [run.trajectory.T_world_cam for run in (here.run, there[0].run)]
    np.testing.assert_array_equal(*poses)


def check_output(report: Path, poses: ContinuousPoses) -> None:
    saved = Trajectory.load(report / NAME / "trajectory.npz")
    np.testing.assert_array_equal(saved.stamped_poses().stamps_ns, poses.stamps_ns)
    assert "GPCT (published)" in (report / "report.html").read_text()
    cost = json.loads((report / NAME / "cost.json").read_text())
    stages = {
        "events and clustering", "tracking", "tracklets", "outlier rejection", "estimation",
    }  # fmt: skip
    assert set(cost["stages"]) == stages
    elapsed = cost["wall_seconds"] + cost["compile_seconds"]
    assert all(0 < seconds <= elapsed for seconds in cost["stages"].values())
    assert sum(cost["stages"].values()) > 0.5 * elapsed
    assert cost["events"] > 0 and cost["machine"]["cores"] >= 1
    assert "wall_seconds" not in (report / "metrics.json").read_text()


def test_what_is_missing_is_said_before_anything_runs(data: Path) -> None:
    with pytest.raises(InputError, match=r"no such folder; put MVSEC.s indoor_flying1_data\.hdf5"):
        main(["--data", str(data / "nowhere")])
    with pytest.raises(InputError, match=r"holds no indoor_flying3_data\.hdf5; put"):
        main(["--data", str(data / "mvsec")])
    with pytest.raises(InputError, match="known are indoor_flying1, indoor_flying3"):
        main(["--data", str(data / "mvsec"), "--sequences", "outdoor_day1"])
    options = ["--data", str(data / "mvsec"), "--sequences", NAME]
    with pytest.raises(InputError, match="--trajectories"):
        main([*options, "--trajectories", str(data / "nowhere")])


def test_a_recording_of_another_time_is_refused(
    recording: SimulatedRecording, data: Path, config_file: Path
) -> None:
    moved_to(SPANS_NS[NAME][1] + 1000, recording).write_mvsec(data / "mvsec" / "indoor_flying")
    with pytest.raises(InputError, match="nothing of the evaluated"):
        main(["--data", str(data / "mvsec"), "--sequences", NAME])
