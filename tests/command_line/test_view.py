"""The viewer's file, read back, of a run and of its results."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo.trajectory import StampedPoses, Trajectory

MOTION = {
    f"{kind}_velocity/{axis}{band}"
    for kind in ("linear", "angular")
    for axis in "xyz"
    for band in ("", "_band")
} | {f"world/{name}" for name in ("path", "uncertainty", "camera", "camera/axes", "ground_truth")}
SEEN = (
    {f"{side}/{name}" for side in ("left", "right") for name in ("events", "tracks", "heads")}
    | {"tracklets/tracklets", "tracklets/inliers", "world/landmarks"}
    | {f"stages/{name}" for name in ("tracking", "estimation", "events_and_clustering")}
)


def entities(file: Path) -> dict[str, int]:
    """Return the number of rows of each entity of a viewer's file."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(file)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows: dict[str, int] = {}
    for count, path in re.findall(r"with (\d+) rows.*?- /?([a-z_/]+)", printed):
        rows[path] = rows.get(path, 0) + int(count)
    return rows


def test_the_file_holds_what_the_run_saw_and_found(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    from gpvo.view.rerun_viewer import RerunViewer

    begins, show_truth = [], RerunViewer.show_truth

    def noted(viewer: RerunViewer, truth: StampedPoses, start_ns: int) -> None:
        begins.append(start_ns)
        show_truth(viewer, truth, start_ns)

    monkeypatch.setattr(RerunViewer, "show_truth", noted)
    file, output = tmp_path / "run.rrd", tmp_path / "out"
    span = ["--start", "0.3", "--duration", "0.4", "--plots", "none"]
    assert gpvo(*recording.arguments(output), *span, "--save", file)[0] == 0
    rows = entities(file)
    assert set(rows) >= MOTION | SEEN
    static = 1  # how the curve is drawn
    assert rows["left/events"] == rows["tracklets/inliers"] - static > 5

    again = tmp_path / "again.rrd"
    assert gpvo("view", output, "--save", again)[0] == 0
    assert set(entities(again)) >= MOTION | {"world/landmarks"}
    trajectory = Trajectory.load(output / "trajectory.npz")
    interval = 0.05
    shown = np.ceil((trajectory.stop - trajectory.start) / interval) + 1  # and its end
    assert entities(again)["world/camera"] == shown
    # The true path begins where the estimated one does, not with the recording's first event.
    first_ns = int(trajectory.stamps_ns(trajectory.start))
    assert begins == pytest.approx([first_ns] * 2, abs=2000)


def test_what_is_no_result_is_one_line(gpvo: Callable, tmp_path: Path) -> None:
    code, _, error = gpvo("view", tmp_path / "nothing")
    assert code == 2 and error.count("\n") == 1
    assert "is no result folder" in error
