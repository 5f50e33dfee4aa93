"""Compare with published errors of ESVO and ESVIO_AA, and given trajectories, on DSEC's drives.

python -m benchmarks.dsec --data DIR [--sequences zurich_city_04_a] [--trajectories DIR]
    [--output DIR]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.data_folder import find_file
from benchmarks.dataset import DatasetSequence, Outcome, arguments, exit_with, run_benchmark
from benchmarks.published import DSEC_ATE
from gpvo.errors import InputError
from gpvo.evaluation.protocol import Protocol
from gpvo.evaluation.report.paper_tables import best_marked, metres
from gpvo.evaluation.report.table import Cell, ResultTable, print_table

PROTOCOL = Protocol(align_body="rotation")
"""Trajectories of others have another rectification, and their ground truth is the lidar's."""


def find_sequence(data: Path, trajectories: Path | None, name: str) -> DatasetSequence:
    """Find the files of a sequence in the user's folders.

    Raises
    ------
    InputError
        If the sequence is unknown or a file is missing; the message says where to put it.
    """
    if name not in DSEC_ATE:
        raise InputError(f"--sequences {name}: known are {', '.join(DSEC_ATE)}")
    drive = name.rpartition("_")[0]
    advice = (
        f"put DSEC's events below it as {name}/events/left/events.h5 and"
        f" {name}/events/right/events.h5 (or {name}_events_left/events.h5 and so on), and"
        f" {name}/calibration/cam_to_cam.yaml; they are at dsec.ifi.uzh.ch. DSEC has no poses: put"
        f" those of a lidar odometry there as {drive}-odometry/pose.bag (tub-rip/dvs_mcemvs), with"
        f" DSEC's cam_to_lidar.yaml beside cam_to_cam.yaml, or poses of the camera as"
        f" {name}/stamped_groundtruth.txt (TUM), there or below --trajectories"
    )
    events = find_file(
        data, [f"{name}/events/left/events.h5", f"{name}_events_left/events.h5"], advice
    )
    calibration = find_file(
        data, [f"{name}/calibration/cam_to_cam.yaml", f"{name}_calibration/cam_to_cam.yaml"], advice
    )
    truths = [f"{drive}-odometry/pose.bag", f"*{name}/stamped_groundtruth.txt"]
    truth = find_file(data, truths, advice, trajectories)
    if truth.suffix == ".bag":
        find_file(calibration.parent, ["cam_to_lidar.yaml"], advice)
    return DatasetSequence(name, events, calibration, truth)


def ate_table(outcomes: Sequence[Outcome]) -> ResultTable:
    """Return a table of our absolute trajectory error beside the published ones."""
    rows = []
    for outcome in outcomes:
        name = outcome.comparison.sequence
        ours = outcome.comparison.evaluations[0].ate["se3"].translation.rmse
        rows.append((Cell(name), *best_marked([ours, *DSEC_ATE[name].values()], metres)))
    headings = ("sequence", "gpvo", "ESVO (published)", "ESVIO_AA (published)")
    return ResultTable("ATE (RMSE), SE(3) aligned", headings, tuple(rows))


def main(
    arguments_given: Sequence[str] | None = None, console: Console | None = None
) -> list[Outcome]:
    """Parse the options and run the benchmark."""
    description = (__doc__ or "").partition("\n")[0]
    options = arguments(description, ["zurich_city_04_a"]).parse_args(arguments_given)
    console = console or Console()
    sequences = [
        find_sequence(options.data, options.trajectories, name) for name in options.sequences
    ]
    outcomes = run_benchmark(options, sequences, PROTOCOL, console)
    print_table(console, ate_table(outcomes))
    return outcomes


if __name__ == "__main__":
    exit_with(main)
