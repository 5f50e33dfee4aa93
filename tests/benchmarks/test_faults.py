"""Short versions of the benchmark of faults: the verdict is right, and the fault is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.fault_cases import FAULTS, standstill
from benchmarks.faults import CAMERAS, FaultResult, main, run_fault, table
from gpvo.errors import InputError
from gpvo.odometry import Odometry
from gpvo.simulation import SimulatedRecording, simulate

CAMERA = "240 x 180"
BY_NAME = {fault.name: fault for fault in FAULTS}


@pytest.fixture(scope="module")
def sound() -> SimulatedRecording:
    return simulate(CAMERAS[CAMERA].model_copy(update={"seed": 3, "duration": 1.2}))


@pytest.fixture(scope="module")
def expected(sound: SimulatedRecording) -> FaultResult:
    return run_fault(CAMERA, 3, BY_NAME["unharmed"], sound)


def test_an_unharmed_recording_is_good_and_nothing_is_said(expected: FaultResult) -> None:
    assert expected.verdict == "good" and expected.said == ()


@pytest.mark.parametrize(
    "name", ["right camera dies", "right loses 70 %", "cameras swapped", "right 4 rows lower"]
)
def test_a_fault_that_harms_is_named(sound: SimulatedRecording, name: str) -> None:
    result = run_fault(CAMERA, 3, BY_NAME[name], sound)
    assert result.is_right(BY_NAME[name]), result


@pytest.mark.parametrize("name", ["a pixel at 1 MHz", "every event twice", "jitter of 2 ms"])
def test_a_fault_without_harm_does_none(
    sound: SimulatedRecording, expected: FaultResult, name: str
) -> None:
    result = run_fault(CAMERA, 3, BY_NAME[name], sound)
    assert result.is_right(BY_NAME[name]) and result.verdict == "good"
    assert result.relative < 1.3 * expected.relative


def test_a_camera_that_stands_still_does_not_move(sound: SimulatedRecording) -> None:
    """Its noise says so: features that stay measure the rest."""
    still = standstill(2.0, 0.2)(sound, 0.8, np.random.default_rng(0))
    odometry = Odometry(still.rig)
    trajectory = odometry.run(still)
    assert np.linalg.norm(np.diff(trajectory.pose([1.3, 1.6])[:, :3, 3], axis=0)) < 0.005
    assert odometry.verdict().word == "good"


@pytest.mark.parametrize(("noise", "latest"), [(0.2, 2.1), (5.0, 2.2)])
def test_a_recording_may_begin_at_rest(
    sound: SimulatedRecording, noise: float, latest: float
) -> None:
    """The camera stands for most of the time: nothing is lost, and nothing is blamed.

    The path begins in the first cluster of which enough landmarks are followed, while it moves.
    """
    still = standstill(2.0, noise)(sound, 0.001, np.random.default_rng(0))
    odometry = Odometry(still.rig)
    trajectory = odometry.run(still)
    least, reports = odometry.configuration.estimator.start_landmarks, odometry.reports
    followed = next(k for k, report in enumerate(reports) if report.inliers >= least)
    first = reports[followed - 1]
    assert 2.0 < trajectory.start < latest
    assert first.start < trajectory.start < first.stop
    assert odometry.verdict().word == "good" and odometry.faults == []


def test_the_table_marks_what_is_right_and_what_harms() -> None:
    rows = [
        FaultResult(CAMERA, 3, "unharmed", 2.0, 1e-3, 6.0, "good", ()),
        FaultResult(CAMERA, 3, "every event twice", 5.0, 1e-3, 6.0, "good", ("twice",)),
        FaultResult(CAMERA, 3, "cameras swapped", np.nan, np.nan, np.nan, "refused", ("x",)),
    ]
    text = table(rows, [BY_NAME[row.fault] for row in rows])
    assert "| every event twice | 5.0 (!) / 1.00e-3, NEES 6, good | 1 of 1 |" in text
    assert "| cameras swapped | refused | 0 of 1 |" in text


def test_an_unknown_fault_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="known are unharmed, right camera dies"):
        main(["--faults", "nothing", "--output", str(tmp_path)])
