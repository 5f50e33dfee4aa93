"""What long recordings lose little by little, and what each part is worth against it.

python -m benchmarks.drift [--cases NAME ...] [--variants NAME ...] [--seeds N] [--jobs N]
    [--duration SECONDS] [--output DIR]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from benchmarks.dataset import exit_with
from benchmarks.drift_cases import ROUND, ROUNDS, long_cases
from benchmarks.drift_summary import DriftResult, case_table
from benchmarks.faults import last_nees
from benchmarks.options import at_least_one, positive
from benchmarks.simulated import STEP, chosen
from benchmarks.simulated_cases import Case
from benchmarks.simulated_summary import write_summary
from factors.lie import se3_inverse
from gpvo.commands.workers import in_order
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation import Evaluation, evaluate
from gpvo.evaluation.metrics.alignment import Alignment, find_alignment
from gpvo.evaluation.metrics.ate_rpe import (
    DeltaUnit,
    absolute_trajectory_error,
    pose_pairs,
    pose_progress,
    relative_motions,
    rotation_angles,
)
from gpvo.evaluation.metrics.statistics import Statistics
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.table import print_table, to_markdown
from gpvo.mapping.recorder import MeasurementRecorder
from gpvo.odometry import Odometry
from gpvo.simulation import SimulatedRecording
from gpvo.tracking import Measurements

VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "without anchors": {"tracking": {"klt": {"anchor_correlation": 1.0}}},
    "without slopes": {"tracking": {"klt": {"slopes": False}}},
    "equal deviations": {"tracking": {"klt": {"deviations": False}}},
    "strongest features": {"tracking": {"klt": {"candidates": 1.0}}},
    "without lag": {"tracking": {"compensation": {"lag_share": 0.0}}},
    "without memory": {
        "tracking": {"klt": {"lost_landmarks": 0}},
        "estimator": {"lost_landmarks": 0},
    },
    "window of 3": {"estimator": {"window": 3}},
    "window of 10": {"estimator": {"window": 10}},
    "preset: paper": {"preset": "paper"},
}
"""What is changed of the configuration, by the name of its row."""


def run_case(case: Case, seed: int, variants: Sequence[str]) -> list[DriftResult]:
    """Simulate a recording, and estimate its motion in every way."""
    recording = case.recording(seed)
    return [run_variant(case.name, seed, variant, recording) for variant in variants]


def run_variant(case: str, seed: int, variant: str, recording: SimulatedRecording) -> DriftResult:
    """Estimate the motion of a recording in one way, and measure what is lost."""
    seen = MeasurementRecorder()
    configuration = Configuration.model_validate({**VARIANTS[variant], "seed": seed})
    odometry = Odometry(recording.rig, configuration, observer=seen)
    try:
        trajectory = odometry.run(recording)
        evaluation = evaluate(ContinuousPoses.of(trajectory), recording.ground_truth, step=STEP)
    except InputError as error:
        return DriftResult(case, seed, variant, failure=str(error))
    translation = evaluation.global_error.statistics("translation")
    return DriftResult(
        case,
        seed,
        variant,
        translation.final_percent,
        translation.rms,
        evaluation.ate["se3"].translation.rmse,
        *drift(evaluation, "metres"),
        *drift(evaluation, "seconds"),
        time_in_view(seen.measurements),
        last_nees(trajectory, recording.ground_truth) / 6.0,
        *(last_round(evaluation) if case == "loop" else (np.nan, np.nan)),
    )


def drift(evaluation: Evaluation, unit: DeltaUnit) -> tuple[float, float]:
    """Compute the RMS drift in metres and radians per metre of the path, or per second.

    Between poses that are half of the recording apart.
    """
    truth, estimate = evaluation.ground_truth, evaluation.estimate
    progress = pose_progress(truth, unit)
    first, last = pose_pairs(truth, 0.5 * progress[-1], unit, all_pairs=True)
    true_motion = relative_motions(truth, first, last)
    T_error = se3_inverse(true_motion) @ relative_motions(estimate, first, last)
    translations = np.linalg.norm(T_error[:, :3, 3], axis=1)
    apart = progress[last] - progress[first]
    angles = rotation_angles(T_error)
    return Statistics.of(translations / apart).rmse, Statistics.of(angles / apart).rmse


def time_in_view(measurements: Measurements) -> float:
    """Compute the median time from a landmark's first measurement to its last one, seconds."""
    order = np.lexsort((measurements.t, measurements.landmark))
    t = measurements.t[order]
    starts = np.flatnonzero(np.diff(measurements.landmark[order], prepend=-1))
    return float(np.median(t[np.append(starts[1:], len(t)) - 1] - t[starts]))


def last_round(evaluation: Evaluation) -> tuple[float, float]:
    """Compute the ATE of the last round over the first one's, aligned as a whole, and by the first.

    NaN without most of a last round.
    """
    estimate, truth = evaluation.estimate, evaluation.ground_truth
    number = truth.seconds // ROUND
    first, last = number == 0, number == ROUNDS - 1
    if last.sum() < 0.9 * first.sum():
        return np.nan, np.nan

    def ratio(alignment: Alignment) -> float:
        errors = (
            absolute_trajectory_error(estimate[part], truth[part], alignment).translation.rmse
            for part in (last, first)
        )
        return next(errors) / next(errors)

    by_first = find_alignment(estimate[first], truth[first])
    return ratio(find_alignment(estimate, truth)), ratio(by_first)


def arguments() -> argparse.ArgumentParser:
    """Return a parser of the options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", nargs="+", metavar="NAME", help="some of the recordings")
    parser.add_argument(
        "--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS), metavar="NAME"
    )
    parser.add_argument("--seeds", type=at_least_one, default=1, help="runs of each")
    parser.add_argument("--duration", type=positive, help="seconds, for shorter recordings")
    parser.add_argument(
        "--jobs", type=at_least_one, default=os.cpu_count(), help="processes at once"
    )
    parser.add_argument("--output", type=Path, help="folder for drift.json and drift.md")
    return parser


def main(
    arguments_given: Sequence[str] | None = None,
    console: Console | None = None,
    suite: Sequence[Case] | None = None,
) -> list[DriftResult]:
    """Parse the options, run, print and write the results."""
    options, console = arguments().parse_args(arguments_given), console or Console()
    cases = chosen(long_cases() if suite is None else suite, options)
    if options.output is not None:
        make_folder(options.output)
    tasks = [(case, seed, options.variants) for case in cases for seed in range(options.seeds)]
    simulations = {case.name: case.config.model_dump(mode="json") for case in cases}
    facts = {"variants": VARIANTS, "simulations": simulations}
    results = []
    for done in in_order(run_case, tasks, options.jobs, None):
        results += done
        for one in done:
            console.print(one.line(), highlight=False, markup=False)
        if options.output is not None:
            write_summary(options.output / "drift.json", results, facts)
    tables = [case_table(results, case.name) for case in cases]
    for table in tables:
        print_table(console, table)
    if options.output is not None:
        (options.output / "drift.md").write_text("\n".join(map(to_markdown, tables)), "utf-8")
    return results


if __name__ == "__main__":
    exit_with(main)
