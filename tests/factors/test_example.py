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


def test_fixed_lag_smoother(capsys: pytest.CaptureFixture[str]) -> None:
    """After ten clusters errors are far below a measurement's (0.1 m deep), also in the dark."""
    errors = load("fixed_lag_smoother").main()[10:]
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
