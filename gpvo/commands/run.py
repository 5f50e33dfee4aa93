"""`gpvo run` and `gpvo demo`: estimate, print the tables, write the results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from gpvo.cluster_report import ClusterReport
from gpvo.commands.inputs import (
    Calibration,
    Config,
    GroundTruth,
    LeftTopic,
    Output,
    RightTopic,
    Seed,
    check_start,
    configured,
    console,
    load_ground_truth,
)
from gpvo.commands.live_trajectory import live_file
from gpvo.commands.progress import run_progress
from gpvo.commands.result import FILES, Result, evaluate_trajectory, save_trajectory
from gpvo.commands.watch import Save, View, Watch
from gpvo.config import Configuration
from gpvo.evaluation.report.compilation import CompilationTimer
from gpvo.evaluation.report.machine import machine_text
from gpvo.evaluation.report.paper_tables import evaluation_tables
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import CostMeter, cost_table, write_cost
from gpvo.evaluation.report.table import to_rich
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.simulation import SimulationConfig, simulate
from gpvo.trajectory import StampedPoses, Trajectory
from gpvo.verdict import Verdict

COMPILING = "compiling for this machine, which the first run does once and takes a minute or two"
NO_WATCH = Watch()
DEAD_RECKONING = 3
"""Exit status for a trajectory that is mostly dead reckoning."""


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
    view: View = False,
    save: Save = None,
) -> None:
    """Estimate the motion of a recording; write trajectory, metrics and plots.

    Exit status 3: most of the trajectory is dead reckoning.
    """
    configuration = configured(config, seed)
    opened = open_recording(recording, calibration, left_topic, right_topic)
    truth = load_ground_truth(ground_truth, opened, calibration) if ground_truth else None
    span = (start, np.inf if duration is None else duration)
    folder = output or Path("results") / recording.stem
    judged = run_and_write(opened, configuration, folder, truth, console, *span, Watch(view, save))
    if judged.word == "failed":
        raise typer.Exit(DEAD_RECKONING)


def demo(output: Output = None, seed: Seed = None) -> None:
    """Simulate a few seconds of stereo events and estimate the motion."""
    simulation = SimulationConfig(seed=1 if seed is None else seed, duration=2.0)
    with console.status("simulating stereo events of a textured room"):
        recording = simulate(simulation)
    folder = output or Path("results") / "demo"
    configuration = configured(None, seed)
    run_and_write(recording, configuration, folder, recording.ground_truth, console)


def run_and_write(
    recording: Recording,
    configuration: Configuration,
    folder: Path,
    truth: StampedPoses | None,
    console: Console,
    start: float = 0.0,
    duration: float = np.inf,
    watch: Watch = NO_WATCH,
) -> Verdict:
    """Estimate the motion from `start` for `duration` seconds and write a result folder.

    Returns the verdict on the run.

    Raises
    ------
    InputError
        If the recording ends before `start`, the folder cannot be written or the events are faulty.
    """
    check_start(recording, start)
    folder = make_folder(folder, FILES)
    meter = CostMeter(compilation=CompilationTimer(lambda: console.print(COMPILING)))
    stop = min(start + duration, recording.duration)
    with (
        watch.observer(meter.stages, truth, recording.start_ns) as observer,
        run_progress(console, start, stop) as show,
    ):
        odometry = Odometry(recording.rig, configuration, meter.stage, observer=observer)
        trajectory = _estimate(odometry, recording, folder, (start, duration), show)
    return write_results(folder, odometry, trajectory, truth, meter, console)


def _estimate(
    odometry: Odometry,
    recording: Recording,
    folder: Path,
    span: tuple[float, float],
    show: Callable[[ClusterReport], None],
) -> Trajectory:
    """Run the odometry while the file of the trajectory grows."""
    final_states = odometry.estimator.final_states
    file = live_file(folder / "trajectory.tum", final_states, lambda: recording.start_ns)
    with file as append_final:

        def advance(report: ClusterReport) -> None:
            show(report)
            append_final()

        return odometry.run(recording, *span, advance)


def write_results(
    folder: Path,
    odometry: Odometry,
    trajectory: Trajectory,
    truth: StampedPoses | None,
    meter: CostMeter,
    console: Console,
) -> Verdict:
    """Write a result folder, and print what was found; return the verdict."""
    reports = odometry.reports
    save_trajectory(trajectory, folder)
    events = sum(report.events for report in reports)
    cost = meter.total(reports[-1].stop - reports[0].start, events)
    evaluation = evaluate_trajectory(trajectory, truth) if truth else None
    diagnostics, judged = odometry.estimator.diagnostics, odometry.verdict()
    configuration = odometry.configuration
    result = Result(trajectory, reports, diagnostics, configuration, judged, evaluation, truth)
    result.write(folder)
    write_cost(folder, cost)
    console.print(result.table())
    console.print(to_rich(cost_table({"gpvo": cost})))
    console.print(machine_text(cost.machine), style="dim", highlight=False)
    if evaluation is not None:
        for table in evaluation_tables(evaluation):
            console.print(to_rich(table))
    console.print(f"results: {folder}")
    return judged
