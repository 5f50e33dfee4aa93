"""Recordings whose motion is known: simulated ones, and one from a file."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.options import positive
from gpvo.evaluation.front_end.truth import Truth, truth_of_poses, truth_of_simulation
from gpvo.evaluation.poses.load import load_poses
from gpvo.recordings import Recording, open_recording
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.trajectory import StampedPoses

SHARED = Path(__file__).resolve().parents[2] / "shared" / "recordings"
"""Folder beside the repository with a recording; it may be missing."""
ROOM = SHARED / "room1_indoor1_data.hdf5"
ROOM_CALIBRATION = SHARED / "camchain-imucam-indoor_flying.yaml"
ROOM_TRUTH = SHARED / "room1_indoor1_gt.hdf5"


@dataclass(frozen=True, eq=False)
class KnownRecording:
    """A part of a recording, from `start` for `duration` seconds, and its ground truth."""

    name: str
    recording: Recording
    ground_truth: StampedPoses
    truth: Truth
    start: float
    duration: float

    @staticmethod
    def simulated(name: str, recording: SimulatedRecording) -> KnownRecording:
        """Return the whole of a simulated recording."""
        truth = truth_of_simulation(recording)
        duration = recording.duration
        return KnownRecording(name, recording, recording.ground_truth, truth, 0.0, duration)


def parse_options(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse the command line, with the options of a recording in a file."""
    parser.add_argument("--recording", type=Path, help="a recording of yours")
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--ground-truth", type=Path)
    parser.add_argument("--start", type=float, default=2.0, help="seconds of it to skip")
    parser.add_argument("--duration", type=positive, default=2.0, help="seconds of each recording")
    options = parser.parse_args()
    if options.recording is not None and options.ground_truth is None:
        parser.error("--recording needs --ground-truth")
    return options


def known_recordings(
    options: argparse.Namespace, simulations: Mapping[str, SimulationConfig]
) -> Iterator[KnownRecording]:
    """Yield the given recording, or the one beside the repository, then the simulated ones."""
    if options.recording is not None:
        yield _of_file(options, options.recording, options.calibration, options.ground_truth)
    elif ROOM.exists():
        yield _of_file(options, ROOM, ROOM_CALIBRATION, ROOM_TRUTH)
    for name, config in simulations.items():
        shortened = config.model_copy(update={"duration": options.duration})
        yield KnownRecording.simulated(name, simulate(shortened))


def _of_file(
    options: argparse.Namespace, path: Path, calibration: Path | None, ground_truth: Path
) -> KnownRecording:
    recording = open_recording(path, calibration)
    poses = load_poses(ground_truth, recording.rig)
    duration = min(options.duration, recording.duration)
    start = float(np.clip(options.start, 0.0, recording.duration - duration))
    truth = truth_of_poses(poses, recording.start_ns)
    return KnownRecording(path.stem, recording, poses, truth, start, duration)
