"""Overview, video, map and the folder of the last run."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from run_files import RecordingFiles

from gpvo.mapping import LandmarkMap


def test_latest_is_the_last_run_with_its_video_and_its_map(
    recording: RecordingFiles, gpvo: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = recording.arguments(tmp_path)[:-2]  # without --output
    assert gpvo(*given, "--video", "tracks.mp4")[0] == 0
    results = tmp_path / "results"
    latest = results / "latest"
    assert os.readlink(latest) in {path.name for path in results.iterdir()}
    assert re.fullmatch(
        recording.data.stem + r"_\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d", os.readlink(latest)
    )

    video = cv2.VideoCapture(str(tmp_path / "tracks.mp4"))
    frames = [video.read()[1] for _ in range(int(video.get(cv2.CAP_PROP_FRAME_COUNT)))]
    assert 0.6 * 30 < len(frames) <= 0.8 * 30 + 1
    height, width = frames[-1].shape[:2]
    assert height >= 3 * 180 and width > 2 * 3 * 240
    assert 0.02 < (frames[-1] < 200).any(axis=2).mean() < 0.6  # mostly white

    overview = cv2.imread(str(latest / "overview.png"))
    assert overview.shape == (990, 1500, 3)
    landmarks = LandmarkMap.load(latest / "map.npz")
    assert len(landmarks) > 20 and (landmarks.depth > 0).all()
    assert np.isfinite(landmarks.deviation).all()
    assert f"element vertex {len(landmarks)}\n".encode() in (latest / "map.ply").read_bytes()

    truth = ["--ground-truth", recording.ground_truth, "--calibration", recording.calibration]
    code, printed, _ = gpvo("eval", latest, *truth)
    assert code == 0
    found = re.search(r"median distance to the true surface\s+([\d.]+) mm,\s+([\d.]+) %", printed)
    assert found is not None and 0 < float(found[2]) < 2.0


def test_a_video_ends_with_mp4(recording: RecordingFiles, gpvo: Callable, tmp_path: Path) -> None:
    code, _, error = gpvo(*recording.arguments(tmp_path / "out"), "--video", "tracks.avi")
    assert (code, error) == (2, "gpvo: tracks.avi: a video ends with .mp4\n")
