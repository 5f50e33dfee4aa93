"""`gpvo eval`: find the files, compare, print, write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from gpvo.commands.inputs import Calibration, GroundTruth, Output, console
from gpvo.commands.map_error import map_error
from gpvo.commands.result import writing
from gpvo.errors import InputError
from gpvo.evaluation.comparison import Comparison, compare
from gpvo.evaluation.poses.find import SequenceSources, find_sources, require_different_names
from gpvo.evaluation.protocol import Contender, Protocol
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import read_cost
from gpvo.evaluation.report.table import print_table


def evaluate(
    estimate: Annotated[Path, typer.Argument(help="Result folder or file of poses.")],
    ground_truth: GroundTruth = None,
    against: Annotated[list[str] | None, typer.Option(help="Competitor as NAME=FILE.")] = None,
    output: Output = None,
    calibration: Calibration = None,
    step: Annotated[
        float | None, typer.Option(help="Compare every STEP seconds, not at the states.")
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
    common_time: Annotated[
        bool, typer.Option("--common-time", help="Compare only the time that all estimates cover.")
    ] = False,
) -> None:
    """Compare estimates with the ground truth: tables, plots, report."""
    protocol = Protocol(
        step,
        truth_between,
        association,
        max_difference,
        aligned_at,
        align_body,
        align_time,
        common_time,
    )
    evaluate_command(estimate, ground_truth, against or (), output, protocol, calibration, console)
    error = map_error(estimate, ground_truth)
    if error is not None:
        console.print(str(error), highlight=False)


def evaluate_command(
    estimate: Path,
    ground_truth: Path | None = None,
    against: Sequence[str] = (),
    output: Path | None = None,
    protocol: Protocol | None = None,
    calibration: Path | None = None,
    console: Console = console,
) -> list[Comparison]:
    """Compare estimates with their ground truth, print the tables and write a report.

    Parameters
    ----------
    estimate, ground_truth
        See `find_sources`.
    against
        Competitors as "NAME=FILE".
    output
        Folder for the report; nothing is written without it.
    protocol
        Protocol of the comparison.
    calibration
        File for ground truths of the raw camera (MVSEC) or of another body (DSEC, TUM-VIE, VECtor).
    console
        Where to print; the terminal by default.

    Raises
    ------
    InputError
        If a file is missing or cannot be used, or the folder cannot be made.
    OutputError
        If the report cannot be written.
    """
    if output is not None:
        make_folder(output)
    named = [parse_competitor(text) for text in against]
    require_different_names(named)
    competitors = dict(named)
    comparisons = []
    for sources in find_sources(estimate, ground_truth, competitors):
        contenders = load_contenders(sources, calibration, at_competitor=bool(competitors))
        comparisons.append(compare(sources.name, contenders, protocol))
        print_comparison(comparisons[-1], console)
    if output is not None:
        from gpvo.evaluation.report.report import write_report  # matplotlib is slow to import

        with writing(output):
            write_report(output, comparisons)
        console.print(f"report: {output / 'report.html'}")
    return comparisons


def parse_competitor(text: str) -> tuple[str, Path]:
    """Split "NAME=FILE" into name and file."""
    name, separator, file = text.partition("=")
    if not (name and separator and file):
        raise InputError(f"--against {text}: expected NAME=FILE")
    return name, Path(file)


def load_contenders(
    sources: SequenceSources, calibration: Path | None, at_competitor: bool
) -> list[Contender]:
    """Read the poses; `at_competitor` selects the states of `at_states_of_competitor`."""
    contenders = [
        Contender(
            one.name,
            *one.load(calibration),
            cost=read_cost(one.estimate),
            files=f"{one.estimate} and {one.ground_truth}",
        )
        for one in sources.estimates
    ]
    return at_states_of_competitor(contenders) if at_competitor else contenders


def at_states_of_competitor(contenders: Sequence[Contender]) -> list[Contender]:
    """Compare the first estimate, and every continuous one, at the first competitor's states.

    Continuous competitors have no states to compare at; if all are continuous, nothing changes.
    """
    first, *others = contenders
    reference = next((one for one in [*others, first] if not one.continuous), None)
    return [
        replace(one, at_states_of=reference)
        if one is not reference and (one is first or one.continuous)
        else one
        for one in contenders
    ]


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Print the tables of one sequence, how they were computed, and warnings."""
    for table in comparison.tables():
        print_table(console, table)
    for warning in comparison.warnings():
        console.print(warning, style="yellow", highlight=False)
    for name, offset in comparison.time_offsets.items():
        console.print(f"{name}: clock offset {1e3 * offset:.1f} ms removed", highlight=False)
    console.print("\n".join(comparison.notes()) + "\n", style="dim", highlight=False)
