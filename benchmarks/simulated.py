"""Accuracy and speed on simulated recordings, several seeds of each kind.

python -m benchmarks.simulated [--cases NAME ...] [--seeds N] [--first-seed N] [--jobs N]
    [--scheduler ADDRESS] [--duration SECONDS] [--output DIR] [--against SUMMARY]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.dataset import configuration_of, exit_with
from benchmarks.options import at_least_one, positive, zero_or_more
from benchmarks.run import run_odometry
from benchmarks.simulated_cases import Case, all_cases
from benchmarks.simulated_summary import (
    CaseResult,
    comparison_table,
    read_summary,
    summary_table,
    write_summary,
)
from gpvo.commands.workers import in_order
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation import evaluate
from gpvo.evaluation.report.machine import machine_text
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import cost_table, total_cost
from gpvo.evaluation.report.table import ResultTable, print_table, to_markdown

STEP = 0.01
"""Seconds between the poses that are compared."""

SHORTEST_PATH = 0.1
"""Shortest path, metres, of which percentages are meaningful."""


def run_case(case: Case, seed: int, configuration: Configuration) -> CaseResult:
    """Simulate, estimate and compare one recording; the same input gives the same errors."""
    recording = case.recording(seed)
    configuration = configuration.model_copy(update={"seed": seed})
    try:
        run = run_odometry(recording, configuration)
        evaluation = evaluate(run.poses, recording.ground_truth, step=STEP)
    except InputError as error:
        return CaseResult(case.name, seed, failure=str(error))
    translation = evaluation.global_error.statistics("translation")
    moved = evaluation.path_length > SHORTEST_PATH
    return CaseResult(
        case.name,
        seed,
        translation.final_percent if moved else np.nan,
        translation.rms,
        float(np.degrees(evaluation.global_error.statistics("rotation").rms)),
        evaluation.relative_error.statistics("se3").rms,
        evaluation.coverage,
        run.cost.real_time_factor,
        run.cost,
    )


def run_suite(
    cases: Sequence[Case],
    seeds: Sequence[int],
    configuration: Configuration,
    workers: tuple[int, str | None],
    keep: Callable[[Sequence[CaseResult]], None],
) -> list[CaseResult]:
    """Run every case with every seed; the results are in this order.

    `workers` are the number of jobs and the address of a Dask scheduler. `keep` is called with the
    results so far after each.
    """
    tasks = [(case, seed, configuration) for case in cases for seed in seeds]
    results = []
    for result in in_order(run_case, tasks, *workers):
        results.append(result)
        keep(results)
    return results


def arguments() -> argparse.ArgumentParser:
    """Return a parser of the options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", nargs="+", metavar="NAME", help="some of the suite")
    parser.add_argument("--seeds", type=at_least_one, default=3, help="runs of each case")
    parser.add_argument("--first-seed", type=zero_or_more, default=0, help="others follow it")
    parser.add_argument("--duration", type=positive, help="seconds, for shorter recordings")
    parser.add_argument(
        "--jobs", type=at_least_one, default=os.cpu_count(), help="processes at once"
    )
    parser.add_argument("--scheduler", help="address of a Dask scheduler, to run there")
    parser.add_argument("--config", type=Path, help="configuration (YAML), see `gpvo config`")
    parser.add_argument("--output", type=Path, help="folder for summary.json, table and plot")
    parser.add_argument("--against", type=Path, help="summary.json of an earlier run")
    parser.set_defaults(seed=None)
    return parser


def chosen(suite: Sequence[Case], options: argparse.Namespace) -> list[Case]:
    """Return the cases that the options name, or all, as long as they say."""
    known = {case.name: case for case in suite}
    unknown = [name for name in options.cases or () if name not in known]
    if unknown:
        raise InputError(f"--cases {unknown[0]}: known are {', '.join(known)}")
    cases = [known[name] for name in options.cases or known]
    return [case if options.duration is None else case.shorter(options.duration) for case in cases]


def main(
    arguments_given: Sequence[str] | None = None,
    console: Console | None = None,
    suite: Sequence[Case] | None = None,
) -> list[CaseResult]:
    """Parse the options, run the suite, print and write the results."""
    options, console = arguments().parse_args(arguments_given), console or Console()
    cases = chosen(all_cases() if suite is None else suite, options)
    simulations = {case.name: case.config.model_dump(mode="json") for case in cases}
    earlier = read_summary(options.against, simulations) if options.against else []
    configuration = configuration_of(options)
    if options.output is not None:
        make_folder(options.output)
    workers = options.jobs, options.scheduler
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    facts = {
        "configuration": configuration.model_dump(mode="json"),
        "simulations": simulations,
    }

    def keep(results: Sequence[CaseResult]) -> None:
        console.print(results[-1].line(), highlight=False, markup=False)
        if options.output is not None:
            write_summary(options.output / "summary.json", results, facts)

    results = run_suite(cases, seeds, configuration, workers, keep)
    tables = [summary_table(results)]
    if options.against:
        tables.append(comparison_table(results, earlier))
    costs = [result.cost for result in results if result.cost is not None]
    if costs:
        tables.append(cost_table({"all runs": total_cost(costs)}))
    for table in tables:
        print_table(console, table)
    for text in dict.fromkeys(machine_text(cost.machine) for cost in costs):
        console.print(
            f"{text}; reading included, loading kernels not", style="dim", highlight=False
        )
    if options.output is not None:
        write(options.output, results, earlier, tables)
    return results


def write(
    folder: Path,
    results: Sequence[CaseResult],
    earlier: Sequence[CaseResult],
    tables: Sequence[ResultTable],
) -> None:
    """Write tables.md and simulated.png."""
    from benchmarks.simulated_plot import suite_figure  # matplotlib is slow to import
    from gpvo.evaluation.report.figures import save_figure

    (folder / "tables.md").write_text("\n".join(map(to_markdown, tables)), encoding="utf-8")
    save_figure(suite_figure(results, earlier), folder / "simulated.png")


if __name__ == "__main__":
    exit_with(main)
