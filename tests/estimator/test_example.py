"""The example of the README of scripts runs, and its errors stay within its own bounds."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from factors.lie import se3_inverse, se3_log

EXAMPLE = Path(__file__).parents[2] / "examples" / "asynchronous_tracklets.py"


def test_asynchronous_tracklets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(EXAMPLE))
    trajectory = example["estimate"]()
    assert capsys.readouterr().out.count("3 sigma") == example["CLUSTERS"]
    t = np.linspace(trajectory.start, trajectory.stop, 50)[1:]
    start = example["true_pose"](np.array([trajectory.start]))
    truth = se3_inverse(start) @ example["true_pose"](t)
    error = se3_log(se3_inverse(truth) @ trajectory.pose(t))
    sigma = np.sqrt(np.diagonal(trajectory.covariance(t), 0, 1, 2)[:, :6])
    assert (np.abs(error) < 3 * sigma).mean() > 0.95
    example["plot"](trajectory, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000
