"""Inputs of the commands: options, configuration and ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from rich.console import Console

from gpvo.config import Configuration, load_configuration
from gpvo.errors import InputError
from gpvo.evaluation.metrics.association import interval_text
from gpvo.evaluation.poses.load import load_poses
from gpvo.recordings import Recording
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import seconds_text

console = Console(markup=False, emoji=False)
"""Console that the commands print to; users' names may have brackets."""

Output = Annotated[Path | None, typer.Option(help="Folder for the results; default: results/NAME.")]
Start = Annotated[float, typer.Option(min=0, help="Seconds to skip.")]
Duration = Annotated[
    float | None, typer.Option(help="Seconds to process; default: all.", show_default=False)
]
RightOffset = Annotated[
    str,
    typer.Option(help="Seconds by which the right camera's stamps are late, or auto to find them."),
]
Plots = Annotated[Literal["png", "pdf", "svg", "none"], typer.Option(help="Format of the plots.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of all random choices; default: 0.")]
Calibration = Annotated[
    Path | None,
    typer.Option(help="kalibr, DSEC, basalt, CameraInfo, M3ED; default: in or beside RECORDING."),
]
Config = Annotated[Path | None, typer.Option(help="YAML, see `gpvo config`; default: preset auto.")]
LeftTopic = Annotated[
    str | None, typer.Option(help="Topic, stream, dataset or file of the left camera.")
]
RightTopic = Annotated[
    str | None, typer.Option(help="Topic, stream, dataset or file of the right camera.")
]
GroundTruth = Annotated[Path | None, typer.Option(help="True poses: MVSEC HDF5, TUM, KITTI, bag.")]


def configured(config: Path | None, seed: int | None) -> Configuration:
    """Return the configuration of the file or the default one, with the seed if one is given."""
    configuration = load_configuration(config) if config else Configuration()
    return configuration if seed is None else configuration.model_copy(update={"seed": seed})


def load_ground_truth(
    path: Path,
    recording: Recording,
    calibration: Path | None = None,
    start: float = 0.0,
    duration: float = np.inf,
) -> StampedPoses:
    """Read the ground truth of a part of a recording; InputError if they share no time."""
    beside = [place for place in (calibration, recording.path) if place is not None]
    poses = load_poses(path, recording.rig, beside)
    stop = min(start + duration, recording.duration)
    start_ns, stop_ns = recording.stamp_ns(start), recording.stamp_ns(stop)
    if poses.stamps_ns[-1] <= start_ns or poses.stamps_ns[0] >= stop_ns:
        part = f"{seconds_text(start_ns)} to {seconds_text(stop_ns)} s"
        raise InputError(
            f"{path}: its poses, from {interval_text(poses)}, have no time in common with what is"
            f" read of {recording.path}, from {part}; check that both use the same clock, or"
            " choose another part by --start and --duration"
        )
    return poses


def check_start(recording: Recording, start: float) -> None:
    """Raise InputError if the recording ends before `start`, seconds, or has no events at all."""
    if recording.duration == 0:
        raise InputError(
            f"{recording.path}: has no two events apart in time: no motion can be seen"
        )
    if start >= recording.duration:
        raise InputError(
            f"{recording.path}: --start {start:g} lies beyond its {recording.duration:.3f} s"
        )


def checked_duration(seconds: float | None) -> float | None:
    """Return a duration; InputError if it is not positive."""
    if seconds is not None and not seconds > 0:
        raise InputError(f"--duration {seconds:g}: give a positive number of seconds")
    return seconds
