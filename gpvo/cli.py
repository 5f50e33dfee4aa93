"""The command line; `gpvo --help` lists its commands."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from rich.console import Console

from gpvo.config.stages import Configuration
from gpvo.config.yaml_file import configuration_text, load_configuration
from gpvo.errors import InputError
from gpvo.recordings import Recording, open_recording

BAD_INPUT = 2
"""Exit status."""

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Continuous-time visual odometry for stereo event cameras.",
)
console = Console()

Output = Annotated[Path | None, typer.Option(help="Folder for the results.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of all random choices.")]
Calibration = Annotated[
    Path | None,
    typer.Option(help="kalibr, DSEC, basalt, CameraInfo, M3ED; if not in or beside it."),
]
Config = Annotated[Path | None, typer.Option(help="YAML, see `gpvo config`.")]
LeftTopic = Annotated[str | None, typer.Option(help="Topic, stream or file of the left camera.")]
RightTopic = Annotated[str | None, typer.Option(help="Topic, stream or file of the right camera.")]
GroundTruth = Annotated[Path | None, typer.Option(help="True poses: MVSEC HDF5, TUM, KITTI, bag.")]


def main() -> None:
    """Entry point; bad input is one line on stderr and exit status 2."""
    try:
        app()
    except InputError as error:
        print(f"gpvo: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)


@app.command()
def run(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording.")],
    calibration: Calibration = None,
    ground_truth: GroundTruth = None,
    output: Output = None,
    config: Config = None,
    start: Annotated[float, typer.Option(min=0, help="Seconds to skip.")] = 0.0,
    duration: Annotated[float | None, typer.Option(min=0, help="Seconds to process.")] = None,
    seed: Seed = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Estimate the motion of a recording; write trajectory, metrics and plots."""
    from gpvo.run_command import load_ground_truth, run_and_write

    configuration = configured(config, seed)
    opened = open_recording(recording, calibration, left_topic, right_topic)
    truth = load_ground_truth(ground_truth, opened, calibration) if ground_truth else None
    span = (start, np.inf if duration is None else duration)
    folder = output or Path("results") / recording.stem
    run_and_write(opened, configuration, folder, truth, console, *span)


@app.command()
def demo(output: Output = None, seed: Seed = None) -> None:
    """Simulate a few seconds of stereo events and estimate the motion."""
    from gpvo.run_command import run_and_write
    from gpvo.simulation.recording import SimulationConfig, simulate

    simulation = SimulationConfig(seed=1 if seed is None else seed, duration=2.0)
    with console.status("simulating stereo events of a textured room"):
        recording = simulate(simulation)
    folder = output or Path("results") / "demo"
    configuration = configured(None, seed)
    run_and_write(recording, configuration, folder, recording.ground_truth, console)


@app.command(name="eval")
def evaluate(
    estimate: Annotated[Path, typer.Argument(help="Result folder or file of poses.")],
    ground_truth: GroundTruth = None,
    against: Annotated[list[str] | None, typer.Option(help="Competitor as NAME=FILE.")] = None,
    output: Output = None,
    calibration: Calibration = None,
    step: Annotated[
        float | None, typer.Option(help="Compare every so many seconds, not at the states.")
    ] = None,
    truth_between: Annotated[
        Literal["linear", "gp"], typer.Option(help="How the ground truth is interpolated.")
    ] = "linear",
    association: Annotated[
        Literal["nearest", "interpolated"],
        typer.Option(help="Which poses ATE, RPE and drift compare."),
    ] = "nearest",
    max_difference: Annotated[
        float | None,
        typer.Option(help="Seconds between associated poses; default 0.02, more for sparse truth."),
    ] = None,
    aligned_at: Annotated[
        Literal["step", "first pose"], typer.Option(help="Frame of the relative error.")
    ] = "step",
    align_body: Annotated[
        Literal["none", "rotation", "full"],
        typer.Option(help="Remove a constant offset between the bodies compared."),
    ] = "none",
    align_time: Annotated[
        bool, typer.Option("--align-time", help="Remove a constant offset between the clocks.")
    ] = False,
) -> None:
    """Compare estimates with the ground truth: tables, plots, report."""
    from gpvo.evaluation.command import evaluate_command
    from gpvo.evaluation.protocol import Protocol

    protocol = Protocol(
        step, truth_between, association, max_difference, aligned_at, align_body, align_time
    )
    evaluate_command(estimate, ground_truth, against or (), output, protocol, calibration, console)


@app.command(name="tune-noise")
def tune_noise(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording.")],
    ground_truth: Annotated[Path, typer.Option(help="True poses.")],
    calibration: Calibration = None,
    config: Config = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Learn Q_c and R by maximum likelihood; print them as YAML for `--config`."""
    from gpvo.commands.tune_noise import noise_text, tuned_on_recording
    from gpvo.run_command import load_ground_truth

    opened = open_recording(recording, calibration, left_topic, right_topic)
    truth = load_ground_truth(ground_truth, opened, calibration)
    configuration = configured(config, None)
    print(noise_text(tuned_on_recording(opened, truth, configuration)), end="")


@app.command(name="config")
def print_configuration() -> None:
    """Print the default configuration with a description of every field."""
    print(configuration_text(Configuration(), described=True), end="")


@app.command(name="inspect")
def inspect_front_end(
    recording: Annotated[
        Path, typer.Argument(help="Stereo event recording, or YAML fields of a simulation.")
    ],
    calibration: Calibration = None,
    ground_truth: GroundTruth = None,
    output: Output = None,
    config: Config = None,
    start: Annotated[float, typer.Option(min=0, help="Seconds to skip.")] = 0.0,
    duration: Annotated[float | None, typer.Option(min=0, help="Seconds to process.")] = None,
    seed: Seed = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Hold features, tracklets, times and MC-RANSAC against the truth: table, JSON, plots."""
    from gpvo.evaluation.front_end.truth import truth_of_poses
    from gpvo.inspection_command import inspect_command, simulated
    from gpvo.run_command import load_ground_truth

    is_simulation = recording.suffix in (".yaml", ".yml")
    opened: Recording = (
        simulated(recording)
        if is_simulation
        else open_recording(recording, calibration, left_topic, right_topic)
    )
    truth = None
    if ground_truth is not None:
        truth = truth_of_poses(
            load_ground_truth(ground_truth, opened, calibration), opened.start_ns
        )
    configuration = configured(config, seed)
    folder = output or Path("results") / recording.stem / "inspection"
    span = (start, np.inf if duration is None else duration)
    inspect_command(opened, truth, configuration, folder, console, *span)


@app.command()
def info(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording.")],
    calibration: Calibration = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Print what a recording holds: sensor, events, calibration, ground truth, faults."""
    from gpvo.recording_commands import info_command

    info_command(recording, calibration, left_topic, right_topic, console)


@app.command(name="convert")
def convert_recording(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording.")],
    output: Annotated[Path, typer.Argument(help="File, or folder for DSEC.")],
    to: Annotated[
        Literal["mvsec", "dsec", "rosbag1", "mcap", "aedat4"] | None,
        typer.Option(help="Format, where the ending of OUTPUT does not tell."),
    ] = None,
    calibration: Calibration = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Write a recording in another format: the same events, and the calibration beside them."""
    from gpvo.recording_commands import convert_command

    convert_command(recording, output, to, calibration, left_topic, right_topic, console)


def configured(config: Path | None, seed: int | None) -> Configuration:
    """The configuration of the file or the default one, with another seed if one is given."""
    configuration = load_configuration(config) if config else Configuration()
    return configuration if seed is None else configuration.model_copy(update={"seed": seed})
