"""What `gpvo run` and `gpvo demo` do: estimate, print the tables, write the results."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from gpvo.config.stages import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.poses.load import load_poses
from gpvo.evaluation.report.machine import machine_text
from gpvo.evaluation.report.paper_tables import evaluation_tables
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import CostMeter, cost_table, write_cost
from gpvo.evaluation.report.table import to_rich
from gpvo.live_file import LiveFile
from gpvo.odometry import ClusterReport, Odometry
from gpvo.progress import RunProgress
from gpvo.recordings import Recording
from gpvo.results import FILES, Result, evaluate_trajectory
from gpvo.trajectory.stamped_poses import StampedPoses


def run_and_write(
    recording: Recording,
    configuration: Configuration,
    folder: Path,
    truth: StampedPoses | None,
    console: Console,
    start: float = 0.0,
    duration: float = np.inf,
) -> None:
    """Estimate the motion from `start` for `duration` seconds and leave a result folder.

    Raises
    ------
    InputError
        If there is nothing at `start`, the folder cannot be written or the events are faulty.
    """
    check_start(recording, start)
    folder = make_folder(folder, FILES)
    meter = CostMeter()
    odometry = Odometry(recording.rig, configuration, meter.stage)
    live = LiveFile(folder / "trajectory.tum", odometry, recording.start_ns)
    stop = min(start + duration, recording.duration)
    with RunProgress(console, start, stop) as progress, live:

        def advance(report: ClusterReport) -> None:
            progress.advance(report)
            live.append_settled()

        trajectory = odometry.run(recording, start, duration, advance)
    events = sum(report.events for report in odometry.reports)
    cost = meter.total(stop - start, events)
    evaluation = evaluate_trajectory(trajectory, truth) if truth else None
    repairs = odometry.estimator.repairs
    result = Result(trajectory, odometry.reports, repairs, configuration, evaluation, truth)
    result.write(folder)
    write_cost(folder, cost)
    console.print(result.table())
    console.print(to_rich(cost_table({"gpvo": cost})))
    console.print(machine_text(cost.machine), style="dim", highlight=False)
    if evaluation is not None:
        for table in evaluation_tables(evaluation):
            console.print(to_rich(table))
    console.print(f"results: {folder}")


def load_ground_truth(
    path: Path, recording: Recording, calibration: Path | None = None
) -> StampedPoses:
    """Poses of the ground truth, checked to share time with the recording."""
    beside = [place for place in (calibration, recording.path) if place is not None]
    poses = load_poses(path, recording.rig, beside)
    end_ns = recording.stamp_ns(recording.duration)
    if poses.stamps_ns[-1] <= recording.start_ns or poses.stamps_ns[0] >= end_ns:
        raise InputError(
            f"{path}: its stamps, from {poses.stamps_ns[0] * 1e-9:.3f} s, have no time in common"
            f" with {recording.path}, from {recording.start_ns * 1e-9:.3f} s"
        )
    return poses


def check_start(recording: Recording, start: float) -> None:
    """Raise InputError if there is nothing of the recording from `start` (seconds) on."""
    if start >= recording.duration:
        raise InputError(
            f"{recording.path}: --start {start:g} lies beyond its {recording.duration:.3f} s"
        )
