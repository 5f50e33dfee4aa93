"""Estimate the motion of a recording, print the tables, write the results: for several commands."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Console

from gpvo.commands.interruption import Interruption, end_at_ctrl_c
from gpvo.commands.live_trajectory import live_file
from gpvo.commands.progress import run_progress
from gpvo.commands.result import Result, evaluate_trajectory, save_trajectory, saved, writing
from gpvo.commands.seen import Seen
from gpvo.commands.watch import Watch
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation import Evaluation
from gpvo.evaluation.report.compilation import CompilationTimer
from gpvo.evaluation.report.machine import machine_text
from gpvo.evaluation.report.paper_tables import evaluation_tables
from gpvo.evaluation.report.run_time import CostMeter, cost_table, write_cost
from gpvo.evaluation.report.table import print_table
from gpvo.observer import observers
from gpvo.odometry import Odometry
from gpvo.recordings import Recording
from gpvo.trajectory import StampedPoses, Trajectory
from gpvo.verdict import Verdict, verdict
from gpvo.warm_up.beside import CompileBeside

COMPILING = "compiling for this machine, which the first run does once, for about a minute"
NO_WATCH = Watch()
DEAD_RECKONING = 3
"""Exit status for a failed run: mostly dead reckoning, or wrong for a fault of the events."""


def run_and_write(
    recording: Recording,
    configuration: Configuration,
    folder: Path,
    truth: StampedPoses | None,
    console: Console,
    start: float = 0.0,
    duration: float = np.inf,
    watch: Watch = NO_WATCH,
    plots: str = "png",
    truth_name: str = "ground truth",
) -> Verdict:
    """Estimate the motion from `start` for `duration` seconds and write to a claimed folder.

    `truth_name` is for messages. Returns the verdict on the run.

    Raises
    ------
    InputError
        If the events are faulty.
    OutputError
        If the results cannot be written.
    """
    beside = CompileBeside()
    meter = CostMeter(compilation=CompilationTimer(lambda: _say_compiling(console, beside)))
    stop = min(start + duration, recording.duration)
    with (
        beside,
        meter.compilation,
        end_at_ctrl_c(saved=lambda: saved(folder)) as interruption,
        writing(folder),
        _ends_without_results(interruption),
    ):
        with (
            watch.observer(meter.stages, truth, recording.start_ns) as observer,
            live_file(folder / "trajectory.tum", lambda: recording.start_ns) as append_final,
            run_progress(console, start, stop, meter.clock) as show,
        ):
            seen = Seen()
            watcher = observers(seen, observer, append_final, lambda step: show(step.report))
            odometry = Odometry(recording.rig, configuration, meter.stage, watcher=watcher)
            trajectory = odometry.run(recording, start, duration, lambda: interruption.happened)
        read = recording.faults.to_dict()
        found = odometry, trajectory, truth, meter, seen
        judged = write_results(folder, *found, console, plots, read, truth_name)
    if interruption.happened:
        raise typer.Exit(interruption.status)
    return judged


def _say_compiling(console: Console, beside: CompileBeside) -> None:
    console.print(COMPILING)
    beside.start()


@contextmanager
def _ends_without_results(interruption: Interruption) -> Iterator[None]:
    """Say that nothing was saved if the run is to end before there is a landmark."""
    try:
        yield
    except InputError:
        if interruption.happened:
            print("gpvo: interrupted; nothing was saved", file=sys.stderr)
            raise typer.Exit(interruption.status) from None
        raise


def write_results(
    folder: Path,
    odometry: Odometry,
    trajectory: Trajectory,
    truth: StampedPoses | None,
    meter: CostMeter,
    seen: Seen,
    console: Console,
    plots: str = "png",
    read: Mapping[str, Any] | None = None,
    truth_name: str = "ground truth",
) -> Verdict:
    """Write a result folder, and print what was found; return the verdict.

    `read` holds the numbers of faulty events that the reader met.
    """
    reports = odometry.reports
    save_trajectory(trajectory, folder)
    events = sum(report.events for report in reports)
    cost = meter.total(reports[-1].stop - reports[0].start, events)
    evaluation = _evaluation(trajectory, truth, truth_name, console) if truth else None
    diagnostics = odometry.estimator.diagnostics
    judged = verdict(reports, odometry.faults, trajectory)
    configuration, streams = odometry.configuration, {**odometry.stream_numbers, "read": read or {}}
    found = judged, evaluation, truth, streams
    result = Result(trajectory, reports, diagnostics, configuration, *found)
    result.write(folder, plots, seen.noise.text)
    landmarks = seen.write(folder, odometry, trajectory, evaluation, plots)
    write_cost(folder, cost)
    console.print(result.table())
    print_table(console, cost_table({"gpvo": cost}))
    console.print(machine_text(cost.machine), style="dim", highlight=False)
    if evaluation is not None:
        for table in evaluation_tables(evaluation):
            print_table(console, table)
    console.print(f"map: {len(landmarks)} landmarks")
    console.print(f"results: {folder}")
    return judged


def _evaluation(
    trajectory: Trajectory, truth: StampedPoses, name: str, console: Console
) -> Evaluation | None:
    """Compare with the truth; a run keeps its results where that is not possible, and says so."""
    try:
        return evaluate_trajectory(trajectory, truth)
    except InputError as error:
        warning = f"{name}: the errors are left out: {error}"
        console.print(warning, style="yellow", highlight=False, soft_wrap=True)
        return None
