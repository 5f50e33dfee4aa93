"""The examples run, and their answers are as good as they say."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_graph_by_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Errors between the states stay within the sigmas that the example plots."""
    plot = tmp_path / "errors.png"
    normalised = load("factors_by_hand").main(plot)
    assert np.abs(normalised).max() < 4
    assert (np.abs(normalised) < 3).mean() > 0.99
    assert plot.stat().st_size > 1000
    assert "landmark" in capsys.readouterr().out


def test_fixed_lag_smoother(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """After ten clusters errors are far below a measurement's (0.1 m deep), also in the dark."""
    plot = tmp_path / "errors.png"
    errors = load("fixed_lag_smoother").main(plot)[10:]
    assert plot.stat().st_size > 1000
    assert np.linalg.norm(errors[:, 3:], axis=1).max() < 0.03
    assert np.linalg.norm(errors[:, :3], axis=1).max() < 0.02
    assert "states" in capsys.readouterr().out


def test_pose_graph(capsys: pytest.CaptureFixture[str]) -> None:
    """Between the measurements poses are known better than a measured one, and velocities too."""
    example = load("pose_graph")
    errors, velocity = example.main()
    assert (errors.std(axis=0) < 0.6 * example.SIGMAS).all()
    assert np.abs(velocity).max() < 0.1
    assert "at all times" in capsys.readouterr().out


def test_tracklets_in_a_graph(capsys: pytest.CaptureFixture[str]) -> None:
    """Tracklets take away most of what the odometry drifts."""
    alone, held = load("tracklets_in_a_graph").main()
    assert held < 0.03 < 0.1 < alone
    assert "tracklets" in capsys.readouterr().out


def test_gps_between_states(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Fixes at their own times, some of them wrong, hold what drifts; sigmas tell how well."""
    plot = tmp_path / "errors.png"
    alone, errors, sigmas = load("gps_between_states").main(plot)
    assert np.linalg.norm(errors, axis=1).max() < 0.3 < 1.0 < np.linalg.norm(alone[-1])
    assert (np.abs(errors / sigmas) < 3).mean() > 0.97
    assert plot.stat().st_size > 1000
    assert "any time" in capsys.readouterr().out


def test_lidar_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Points at their own times know the motion ten times better than whole scans."""
    plot = tmp_path / "errors.png"
    own, scans = load("lidar_points").main(plot)
    largest = [np.linalg.norm(errors[:, 3:], axis=1).max() for errors in (own, scans)]
    assert largest[0] < 3e-3 < 10 * largest[0] < largest[1]
    assert plot.stat().st_size > 1000
    assert "whole scans" in capsys.readouterr().out


def test_imu_and_events(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The IMU holds the motion in the dark, and its bias is found."""
    example, plot = load("imu_and_events"), tmp_path / "errors.png"
    alone, helped, bias = example.main(plot)
    largest = [np.linalg.norm(errors[:, 3:], axis=1).max() for errors in (alone, helped)]
    assert largest[1] < 0.02 < 0.04 < largest[0]
    np.testing.assert_allclose(bias.gyroscope(), example.BIAS.gyroscope(), atol=0.01)
    np.testing.assert_allclose(bias.accelerometer(), example.BIAS.accelerometer(), atol=0.06)
    assert plot.stat().st_size > 1000
    assert "IMU" in capsys.readouterr().out


def test_planar_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plot = tmp_path / "path.png"
    found, expected = load("planar_robot").main(plot)
    errors = np.linalg.norm(found - expected, axis=1)
    assert errors.mean() < 0.03 and np.linalg.norm(expected[-1]) > 2
    assert plot.stat().st_size > 1000
    assert "mean error" in capsys.readouterr().out


def test_mc_ransac(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Half of the segments are wrong; none of these is taken, and few others are lost."""
    example, plot = load("mc_ransac"), tmp_path / "segments.png"
    fit, good = example.main(plot)
    assert not (fit.inliers & ~good).any() and fit.inliers.sum() > 0.9 * good.sum()
    deviations = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(fit.velocity - example.TWIST) < 3 * deviations).all()
    assert plot.stat().st_size > 1000
    assert "inliers" in capsys.readouterr().out
