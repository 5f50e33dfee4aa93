"""An inspection finds the errors that were added to exact tracklets."""

from __future__ import annotations

import errno
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console
from typer.testing import CliRunner

from factors.lie import se3_exp
from factors.stereo import StereoCamera
from gpvo.commands.cli import app
from gpvo.commands.inspect import inspect_command
from gpvo.config import Configuration, TrackingConfig
from gpvo.config.stages import KltConfig
from gpvo.errors import InputError, OutputError
from gpvo.evaluation.front_end.inspect import (
    AGREEMENT,
    InspectedCluster,
    JudgedTracklets,
    inspect,
    judge,
)
from gpvo.evaluation.front_end.report import FILES, tracklet_strip
from gpvo.evaluation.front_end.summary import flow_slopes, summarize
from gpvo.evaluation.front_end.truth import Truth, truth_of_poses, truth_of_simulation
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.tracking import Measurements
from gpvo.trajectory import StampedPoses

CAMERA = StereoCamera(200.0, 200.0, 120.0, 90.0, 0.1)
TWIST = np.array([0.1, -0.3, 0.2, 0.3, 0.1, 0.2])
SIMULATION = SimulationConfig(
    seed=3, motion="fast", duration=0.35, resolution=(240, 180), focal_length=160.0
)
FEW = Configuration(tracking=TrackingConfig(klt=KltConfig(max_features=40)))


def constant_truth(with_depth: bool = False, depth: float = 2.0) -> Truth:
    """Make the truth of a camera with constant twist; the depth, if known, is constant."""

    def pose(t: NDArray) -> NDArray:
        return se3_exp(np.asarray(t)[:, None] * TWIST)

    known = (lambda t, pixels: np.full(len(t), depth)) if with_depth else None
    return Truth(0.0, 1.0, pose, known)


def exact(truth: Truth, count: int = 50) -> tuple[Measurements, Measurements]:
    """Make tracklets of static points at depths of 1.5 to 5 m."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-1, -0.7, 1.5], [1, 0.7, 5], (count, 3))
    start = rng.uniform(0.0, 0.5, count)
    ends = []
    for t in (start, start + rng.uniform(0.1, 0.4, count)):
        stereo = truth.projection(points, t, CAMERA)
        ends.append(Measurements(np.arange(count), np.zeros(count, np.int64), t, stereo))
    return ends[0], ends[1]


def judged(earlier: Measurements, later: Measurements, truth: Truth) -> JudgedTracklets:
    return judge(earlier, later, np.ones(len(later), bool), truth, CAMERA)


def test_exact_tracklets_have_no_error() -> None:
    truth = constant_truth()
    tracklets = judged(*exact(truth), truth)
    assert tracklets.agree.all()
    np.testing.assert_allclose(tracklets.error, 0, atol=1e-9)
    np.testing.assert_allclose(tracklets.true_flow, tracklets.measured_flow, atol=1e-9)
    assert flow_slopes(tracklets)["slope"] == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("late", [-0.002, 0.0005, 0.003])
def test_late_times_are_found(late: float) -> None:
    truth = constant_truth()
    earlier, later = exact(truth)
    tracklets = judged(earlier, replace(later, t=later.t + late), truth)
    fast = np.isfinite(tracklets.time_error)
    assert fast.sum() > 30
    np.testing.assert_allclose(tracklets.time_error[fast], late, rtol=0.05)


def test_wrong_positions_and_disparities_are_found() -> None:
    truth = constant_truth()
    earlier, later = exact(truth)
    offset = np.array([0.3, -0.2, 0.4])
    tracklets = judged(earlier, replace(later, stereo=later.stereo + offset), truth)
    np.testing.assert_allclose(tracklets.error, np.tile(offset, (50, 1)), atol=1e-9)
    np.testing.assert_allclose(tracklets.disparity_error, 0.4, atol=1e-9)
    far = later.stereo + np.array([AGREEMENT + 0.01, 0, 0])
    assert not judged(earlier, replace(later, stereo=far), truth).agree.any()


def test_disparities_are_held_against_the_true_depth() -> None:
    truth = constant_truth(with_depth=True, depth=2.0)
    earlier, later = exact(truth)
    expected = later.stereo[:, 2] - CAMERA.fx * CAMERA.baseline / 2.0
    tracklets = judged(earlier, later, truth)
    np.testing.assert_allclose(tracklets.disparity_error, expected, atol=1e-12)


def test_flow_that_is_held_back_has_a_smaller_slope() -> None:
    truth = constant_truth()
    earlier, later = exact(truth)
    flow = later.stereo - earlier.stereo
    slow = earlier.stereo + flow * [0.98, 0.97, 1.0]
    slopes = flow_slopes(judged(earlier, replace(later, stereo=slow), truth))
    assert slopes["slope_u"] == pytest.approx(0.98, abs=1e-9)
    assert slopes["slope_v"] == pytest.approx(0.97, abs=1e-9)


def test_outside_the_truth_nothing_is_judged() -> None:
    truth = replace(constant_truth(), stop=0.45)
    earlier, later = exact(constant_truth())
    tracklets = judged(earlier, later, truth)
    np.testing.assert_array_equal(np.isfinite(tracklets.distance), later.t <= 0.45)
    assert not tracklets.agree[later.t > 0.45].any()


def test_truth_of_poses_is_their_interpolation() -> None:
    truth = constant_truth()
    stamps = 10**12 + np.arange(0, 10**9 + 1, 10**6)
    poses = StampedPoses(stamps, truth.pose((stamps - 10**12) * 1e-9))
    sampled = truth_of_poses(poses, 10**12)
    t = np.array([0.3217, 0.1, 0.3217, 0.99])
    np.testing.assert_allclose(sampled.pose(t), truth.pose(t), atol=1e-6)
    np.testing.assert_allclose(sampled.mean_twist(0.2, 0.6), TWIST, atol=1e-6)
    assert (sampled.start, sampled.stop) == (0.0, 1.0)


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return simulate(SIMULATION)


@pytest.fixture(scope="module")
def clusters(recording: SimulatedRecording) -> list[InspectedCluster]:
    return inspect(recording, truth_of_simulation(recording), FEW)


def test_summary_of_a_simulated_room(clusters: list[InspectedCluster]) -> None:
    summary = summarize(clusters)
    assert summary["clusters"]["clusters"] == len(clusters)
    assert summary["tracklets"]["agreeing_share"] > 0.95
    assert summary["flow"]["slope"] == pytest.approx(1, abs=0.01)
    assert summary["MC-RANSAC"]["precision"] > 0.97
    assert summary["MC-RANSAC"]["recall"] > 0.9
    assert summary["inlier errors"]["left_rms_px"] < 0.5
    fast, iterative = (
        summary["MC-RANSAC"][f"{version}_linear_rms_m_s"] for version in ("fast", "iterative")
    )
    assert iterative < fast


def test_truth_that_covers_little_is_refused(recording: SimulatedRecording) -> None:
    """Its numbers would be of few tracklets, or none."""
    stamps_ns = recording.start_ns + np.array([300_000_000, 340_000_000])
    poses = StampedPoses(stamps_ns, recording.motion.pose(np.array([0.3, 0.34])))
    truth = truth_of_poses(poses, recording.start_ns, "late.txt")
    with pytest.raises(InputError, match=r"late\.txt: its poses, from 0\.300 to 0\.340 s"):
        inspect(recording, truth, FEW)


def test_strip_shows_right_tracklets_in_green(clusters: list[InspectedCluster]) -> None:
    strip = tracklet_strip(clusters, 240)
    assert strip.shape[2] == 3 and strip.shape[1] == 3 * 2 * 240
    pictures = strip[100:]  # below the legend
    green = (pictures == (60, 160, 0)).all(axis=2).sum()
    red = (pictures == (0, 0, 230)).all(axis=2).sum()
    assert green > 500 and red < 0.05 * green


def test_command_simulates_and_writes_everything(tmp_path: Path) -> None:
    description = tmp_path / "slow.yaml"
    description.write_text(
        "{seed: 3, motion: fast, duration: 0.2, resolution: [120, 90], focal_length: 80}"
    )
    result = CliRunner().invoke(app, ["inspect", str(description), "--output", str(tmp_path / "a")])
    assert result.exit_code == 0, result.output
    assert {file.name for file in (tmp_path / "a").iterdir()} == {*FILES, "config.yaml"}
    numbers = json.loads((tmp_path / "a" / "inspection.json").read_text())
    assert numbers["clusters"]["clusters"] >= 2
    assert "NaN" not in (tmp_path / "a" / "inspection.json").read_text()


def test_a_full_disk_is_one_line(
    recording: SimulatedRecording,
    clusters: list[InspectedCluster],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("gpvo.commands.inspect.inspect", lambda *_: clusters)
    monkeypatch.setattr("gpvo.evaluation.front_end.report.save_figure", full)
    with pytest.raises(OutputError, match=r"a: cannot be written \(No space left on device"):
        inspect_command(recording, None, FEW, tmp_path / "a", Console())


def test_bad_input_is_named(recording: SimulatedRecording, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("motion: sideways")
    result = CliRunner().invoke(app, ["inspect", str(path)])
    assert isinstance(result.exception, InputError) and "motion" in str(result.exception)
    with pytest.raises(InputError, match="--start"):
        inspect_command(recording, None, FEW, tmp_path, Console(), start=9.0)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        inspect_command(recording, None, FEW, tmp_path / "file", Console())


def test_a_simulation_without_events_is_said_to_have_none(tmp_path: Path) -> None:
    still = tmp_path / "still.yaml"
    still.write_text("{motion: still, duration: 0.02, resolution: [40, 30], focal_length: 30}")
    with pytest.raises(InputError, match="has no two events apart in time"):
        CliRunner().invoke(app, ["inspect", str(still)], catch_exceptions=False)
