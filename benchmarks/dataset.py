"""Common part of the benchmarks that compare the odometry with others on a data set."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from benchmarks.data_folder import find_trajectories
from benchmarks.options import at_least_one
from benchmarks.run import Run, run_odometry
from gpvo.commands.evaluate import at_states_of_competitor, print_comparison
from gpvo.commands.workers import in_order
from gpvo.config import Configuration, load_configuration
from gpvo.errors import InputError
from gpvo.evaluation.comparison import Comparison, compare
from gpvo.evaluation.poses.load import load_poses
from gpvo.evaluation.protocol import Contender, Protocol
from gpvo.evaluation.report.paper_tables import ErrorRow
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import write_cost
from gpvo.recordings import Recording, open_recording
from gpvo.trajectory.stamped_poses import seconds_text


@dataclass(frozen=True)
class DatasetSequence:
    """Files of one sequence.

    Attributes
    ----------
    name
        Name of the sequence in the data set.
    recording, calibration, ground_truth
        Files of the user.
    span_ns
        Absolute first and last stamp to process, or None for all.
    published
        Published rows of other systems, for the paper's tables.
    """

    name: str
    recording: Path
    calibration: Path | None
    ground_truth: Path
    span_ns: tuple[int, int] | None = None
    published: list[ErrorRow] = field(default_factory=list)


@dataclass(frozen=True)
class Outcome:
    """Our run on a sequence, and its comparison with others."""

    comparison: Comparison
    run: Run


def arguments(description: str, sequences: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser of the options that the benchmarks of all data sets share."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--data", type=Path, required=True, help="folder with the data set")
    parser.add_argument("--sequences", nargs="+", default=list(sequences), metavar="NAME")
    parser.add_argument(
        "--trajectories", type=Path, help="folder of others' results: SEQUENCE/NAME.txt (TUM)"
    )
    parser.add_argument("--config", type=Path, help="configuration (YAML), see `gpvo config`")
    parser.add_argument("--seed", type=int, help="seed of all random choices")
    parser.add_argument("--output", type=Path, help="folder for report, trajectories and costs")
    parser.add_argument("--jobs", type=at_least_one, default=1, help="sequences at once")
    parser.add_argument("--scheduler", help="address of a Dask scheduler, to run there")
    return parser


def run_benchmark(
    options: argparse.Namespace,
    sequences: Sequence[DatasetSequence],
    protocol: Protocol,
    console: Console,
) -> list[Outcome]:
    """Run all sequences, print the comparisons, and write them if --output is given."""
    configuration = configuration_of(options)
    if options.output is not None:
        make_folder(options.output)
    tasks = [(sequence, configuration, options.trajectories, protocol) for sequence in sequences]
    outcomes = []
    for outcome in in_order(run_sequence, tasks, options.jobs, options.scheduler):
        outcomes.append(outcome)
        print_comparison(outcomes[-1].comparison, console)
    if options.output is not None:
        write_outcomes(options.output, outcomes)
        console.print(f"report: {options.output / 'report.html'}")
    return outcomes


def configuration_of(options: argparse.Namespace) -> Configuration:
    """Return the configuration of the options --config and --seed."""
    configuration = load_configuration(options.config) if options.config else Configuration()
    if options.seed is None:
        return configuration
    return configuration.model_copy(update={"seed": options.seed})


def run_sequence(
    sequence: DatasetSequence,
    configuration: Configuration,
    trajectories: Path | None,
    protocol: Protocol,
) -> Outcome:
    """Estimate the motion and compare it with the truth at the first competitor's states."""
    recording = open_recording(sequence.recording, sequence.calibration)
    span = seconds_of(sequence.span_ns, recording)
    beside = [sequence.calibration] if sequence.calibration else []
    truth = load_poses(sequence.ground_truth, recording.rig, beside)
    others = [
        Contender(name, load_poses(path), truth)
        for name, path in find_trajectories(trajectories, sequence.name).items()
    ]
    run = run_odometry(recording, configuration, *span)
    ours = Contender("gpvo", run.poses, truth, cost=run.cost)
    contenders = at_states_of_competitor([ours, *others])
    return Outcome(compare(sequence.name, contenders, protocol, sequence.published), run)


def seconds_of(span_ns: tuple[int, int] | None, recording: Recording) -> tuple[float, float]:
    """Convert an absolute span to its start and duration in the recording, seconds."""
    if span_ns is None:
        return 0.0, recording.duration
    first, last = ((stamp - recording.start_ns) * 1e-9 for stamp in span_ns)
    start, stop = max(first, 0.0), min(last, recording.duration)
    if start >= stop:
        ends = (recording.start_ns, recording.stamp_ns(recording.duration))
        raise InputError(
            f"{recording.path}: covers {' to '.join(map(seconds_text, ends))} s, nothing of the"
            f" evaluated {' to '.join(map(seconds_text, span_ns))} s; is it another sequence?"
        )
    return start, stop - start


def write_outcomes(folder: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the report, and every trajectory with its cost."""
    from gpvo.evaluation.report.report import write_report  # matplotlib is slow to import

    write_report(folder, [outcome.comparison for outcome in outcomes])
    for outcome in outcomes:
        place = folder / outcome.comparison.sequence
        outcome.run.trajectory.save(place / "trajectory.npz")
        write_cost(place, outcome.run.cost)


def exit_with(main: Callable[[], object]) -> None:
    """Run a benchmark's main; bad input gives one line on stderr and exit status 2."""
    try:
        main()
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
