"""`gpvo inspect`: comparison of the front end with the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from gpvo.commands.inputs import (
    Calibration,
    Config,
    Duration,
    GroundTruth,
    LeftTopic,
    Output,
    RightTopic,
    Seed,
    check_start,
    checked_duration,
    configured,
    console,
    load_ground_truth,
)
from gpvo.commands.result import writing
from gpvo.config import Configuration, configuration_text, load_fields
from gpvo.errors import InputError
from gpvo.evaluation.front_end.inspect import inspect
from gpvo.evaluation.front_end.summary import summarize
from gpvo.evaluation.front_end.truth import Truth, truth_of_poses, truth_of_simulation
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.recordings import Recording, open_recording
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate


def inspect_front_end(
    recording: Annotated[
        Path, typer.Argument(help="Stereo event recording, or YAML fields of a simulation.")
    ],
    calibration: Calibration = None,
    ground_truth: GroundTruth = None,
    output: Output = None,
    config: Config = None,
    start: Annotated[float, typer.Option(min=0, help="Seconds to skip.")] = 0.0,
    duration: Duration = None,
    seed: Seed = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Compare features, tracklets, times and MC-RANSAC with the truth: table, JSON, plots."""
    is_simulation = recording.suffix in (".yaml", ".yml")
    opened: Recording = (
        simulated(recording)
        if is_simulation
        else open_recording(recording, calibration, left_topic, right_topic)
    )
    check_start(opened, start)
    span = start, checked_duration(duration) or np.inf
    truth = None
    if ground_truth is not None:
        poses = load_ground_truth(ground_truth, opened, calibration, *span)
        truth = truth_of_poses(poses, opened.start_ns, str(ground_truth))
    configuration = configured(config, seed)
    folder = output or Path("results") / recording.stem / "inspection"
    inspect_command(opened, truth, configuration, folder, console, *span)


def simulated(path: Path) -> SimulatedRecording:
    """Simulate the recording that a YAML file with fields of `SimulationConfig` describes.

    Raises
    ------
    InputError
        If the file cannot be read or a field is wrong.
    """
    fields = ", ".join(SimulationConfig.model_fields)
    return simulate(load_fields(path, SimulationConfig, f"the fields are {fields}"))


def inspect_command(
    recording: Recording,
    truth: Truth | None,
    configuration: Configuration,
    folder: Path,
    console: Console,
    start: float = 0.0,
    duration: float = np.inf,
) -> None:
    """Inspect a recording; print the table and write everything into the folder."""
    # matplotlib is slow to import
    from gpvo.evaluation.front_end.report import FILES, inspection_table, write_inspection

    if truth is None:
        if not isinstance(recording, SimulatedRecording):
            raise InputError(f"{recording.path}: to be inspected needs --ground-truth FILE")
        truth = truth_of_simulation(recording)
    check_start(recording, start)
    make_folder(folder, FILES)
    with console.status("inspecting the front end") as status:
        clusters = inspect(
            recording,
            truth,
            configuration,
            start,
            duration,
            lambda cluster: status.update(f"inspecting the front end: {cluster.stop:.2f} s"),
        )
    summary = summarize(clusters)
    with writing(folder):
        write_inspection(folder, clusters, summary, recording.rig.resolution[0])
        (folder / "config.yaml").write_text(configuration_text(configuration))
    console.print(inspection_table(summary))
    console.print(f"results: {folder}")
