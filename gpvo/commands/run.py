"""`gpvo run` and `gpvo demo`: estimate, print the tables, write the results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from gpvo.cluster_report import ClusterReport
from gpvo.commands.inputs import (
    Calibration,
    Config,
    Duration,
    GroundTruth,
    LeftTopic,
    Output,
    Plots,
    RightOffset,
    RightTopic,
    Seed,
    Start,
    check_start,
    checked_duration,
    configured,
    console,
    load_ground_truth,
)
from gpvo.commands.interruption import Interruption, end_at_ctrl_c
from gpvo.commands.live_trajectory import live_file
from gpvo.commands.many import run_many
from gpvo.commands.map_error import map_error
from gpvo.commands.progress import run_progress
from gpvo.commands.provenance import (
    FILE,
    Request,
    absolute,
    calibration_of,
    read_provenance,
    write_provenance,
)
from gpvo.commands.result import (
    FILES,
    Result,
    evaluate_trajectory,
    save_trajectory,
    saved,
    writing,
)
from gpvo.commands.seen import Seen
from gpvo.commands.watch import Save, Video, View, Watch
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.report.compilation import CompilationTimer
from gpvo.evaluation.report.machine import machine_text
from gpvo.evaluation.report.paper_tables import evaluation_tables
from gpvo.evaluation.report.result_folder import claim_folder, new_folder
from gpvo.evaluation.report.run_time import CostMeter, cost_table, write_cost
from gpvo.evaluation.report.table import to_rich
from gpvo.mapping.scene_file import SCENE_FILE, write_scene
from gpvo.observer import observers
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.recordings.right_offset import with_right_offset
from gpvo.simulation import SimulationConfig, simulate
from gpvo.trajectory import StampedPoses, Trajectory
from gpvo.verdict import Verdict, verdict
from gpvo.warm_up import CompileBeside

COMPILING = "compiling for this machine, which the first run does once, for about a minute"
NO_WATCH = Watch()
DEAD_RECKONING = 3
"""Exit status for a failed run: mostly dead reckoning, or wrong for a fault of the events."""


def run(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Stereo event recording, or many.")
    ] = None,
    calibration: Calibration = None,
    ground_truth: GroundTruth = None,
    output: Output = None,
    config: Config = None,
    start: Start = 0.0,
    duration: Duration = None,
    seed: Seed = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
    right_offset: RightOffset = "0",
    plots: Plots = "png",
    repeat: Annotated[
        Path | None, typer.Option(help="Result folder, to make its run again as it was.")
    ] = None,
    view: View = False,
    save: Save = None,
    video: Video = None,
    jobs: Annotated[int, typer.Option(min=1, help="Of many recordings, how many at once.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, to run many recordings there.")
    ] = None,
) -> None:
    """Estimate the motion of a recording; write trajectory, metrics and plots.

    Many recordings: {} in --calibration and --ground-truth is a recording's name, and each has a
    folder in --output; the same command again runs those that are not finished.

    Exit status 2: bad input. 3: failed, most of the trajectory is dead reckoning, or the clocks are
    apart. 4: results cannot be written. 130 and 143: ended by Ctrl-C or SIGTERM, with the results
    so far.
    """
    watch = Watch(view, save, video)
    if len(recordings or []) > 1:
        _refuse_for_many({"--repeat": repeat, "--view": view, "--save": save, "--video": video})
    if repeat is not None:
        if recordings:
            raise InputError("--repeat: takes the recording of that run; give no other")
        request, configuration = read_provenance(repeat)
        folder = output or repeat.with_name(f"{repeat.name}_repeated")
    else:
        if not recordings:
            raise InputError("recording: give a stereo event recording, or --repeat DIR")
        configuration = configured(config, seed)
        common = start, checked_duration(duration), left_topic, right_topic, right_offset
        requests = [
            Request(
                str(recording.absolute()),
                absolute(calibration_of(recording, _of(calibration, recording))),
                absolute(_of(ground_truth, recording)),
                *common,
            )
            for recording in recordings
        ]
        if len(requests) > 1:
            folder, workers = output or new_folder("many"), (jobs, scheduler)
            status = run_many(requests, configuration, folder, plots, workers, console)
            raise typer.Exit(status)
        request, folder = requests[0], output or new_folder(recordings[0].stem)
    judged = _run(request, configuration, folder, plots, watch)
    if judged.word == "failed":
        raise typer.Exit(DEAD_RECKONING)


def _of(pattern: Path | None, recording: Path) -> Path | None:
    """Return a recording's file, where {} is its name."""
    return None if pattern is None else Path(str(pattern).replace("{}", recording.stem))


def _refuse_for_many(given: Mapping[str, object]) -> None:
    """Raise InputError if an option is given that is for one recording."""
    for option, value in given.items():
        if value:
            raise InputError(
                f"{option}: is for one recording; leave it out, or run them one by one"
            )


def _run(
    request: Request, configuration: Configuration, folder: Path, plots: str, watch: Watch
) -> Verdict:
    """Open what was asked for, estimate, and write the results."""
    path, files = Path(request.recording), request.files
    calibration = files.get("calibration")
    opened = open_recording(path, calibration, request.left_topic, request.right_topic)
    opened = with_right_offset(opened, request.right_offset)
    truth = files.get("ground_truth")
    poses = load_ground_truth(truth, opened, calibration) if truth else None
    duration = np.inf if request.duration is None else request.duration
    check_start(opened, request.start)
    folder = claim_folder(folder, FILES)
    with writing(folder):
        write_provenance(folder, request, configuration)
    span = request.start, duration
    try:
        return run_and_write(opened, configuration, folder, poses, console, *span, watch, plots)
    except InputError:
        (folder / FILE).unlink(missing_ok=True)
        raise


def demo(output: Output = None, seed: Seed = None) -> None:
    """Simulate a few seconds of stereo events and estimate the motion."""
    simulation = SimulationConfig(seed=1 if seed is None else seed, duration=2.0)
    with console.status("simulating stereo events of a textured room"):
        recording = simulate(simulation)
    folder = claim_folder(output or new_folder("demo"), FILES)
    configuration = configured(None, seed)
    run_and_write(recording, configuration, folder, recording.ground_truth, console)
    write_scene(folder / SCENE_FILE, recording.scene.boxes)
    error = map_error(folder)
    if error is not None:
        console.print(str(error), highlight=False)


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
) -> Verdict:
    """Estimate the motion from `start` for `duration` seconds and write to a claimed folder.

    Returns the verdict on the run.

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
            run_progress(console, start, stop) as show,
        ):
            seen = Seen()
            looks = observers(seen, observer)
            odometry = Odometry(recording.rig, configuration, meter.stage, observer=looks)
            span = start, duration
            trajectory = _estimate(odometry, recording, folder, span, show, interruption)
        read = recording.faults.to_dict()
        judged = write_results(
            folder, odometry, trajectory, truth, meter, seen, console, plots, read
        )
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


def _estimate(
    odometry: Odometry,
    recording: Recording,
    folder: Path,
    span: tuple[float, float],
    show: Callable[[ClusterReport], None],
    interruption: Interruption,
) -> Trajectory:
    """Run the odometry while the file of the trajectory grows, until it is to end."""
    final_states = odometry.estimator.final_states
    file = live_file(folder / "trajectory.tum", final_states, lambda: recording.start_ns)
    with file as append_final:

        def advance(report: ClusterReport) -> None:
            show(report)
            append_final()

        return odometry.run(recording, *span, advance, lambda: interruption.happened)


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
) -> Verdict:
    """Write a result folder, and print what was found; return the verdict.

    `read` holds the numbers of faulty events that the reader met.
    """
    reports = odometry.reports
    save_trajectory(trajectory, folder)
    events = sum(report.events for report in reports)
    cost = meter.total(reports[-1].stop - reports[0].start, events)
    evaluation = evaluate_trajectory(trajectory, truth) if truth else None
    diagnostics = odometry.estimator.diagnostics
    judged = verdict(reports, odometry.faults, trajectory)
    configuration, streams = odometry.configuration, {**odometry.stream_numbers, "read": read or {}}
    found = judged, evaluation, truth, streams
    result = Result(trajectory, reports, diagnostics, configuration, *found)
    result.write(folder, plots, seen.noise.text)
    landmarks = seen.write(folder, odometry, trajectory, evaluation, plots)
    write_cost(folder, cost)
    console.print(result.table())
    console.print(to_rich(cost_table({"gpvo": cost})))
    console.print(machine_text(cost.machine), style="dim", highlight=False)
    if evaluation is not None:
        for table in evaluation_tables(evaluation):
            console.print(to_rich(table))
    console.print(f"map: {len(landmarks)} landmarks")
    console.print(f"results: {folder}")
    return judged
