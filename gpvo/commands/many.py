"""`gpvo run A B C`: many recordings, each in a process and a folder of its own."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rich.console import Console

from gpvo.commands.one_recording import Outcome, run_one
from gpvo.commands.provenance import Request, read_provenance
from gpvo.commands.workers import in_order
from gpvo.config import Configuration, configuration_text
from gpvo.errors import InputError
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import COST_FILE
from gpvo.evaluation.report.table import Cell, ResultTable, print_table
from gpvo.trajectory.whole_file import whole_file

SUMMARY = "summary.json"
FINISHED = (0, 3)
"""Exit statuses of runs that came to their end, the second one with a failed trajectory."""


def run_many(
    requests: Sequence[Request],
    configuration: Configuration,
    folder: Path,
    plots: str,
    workers: tuple[int, str | None],
    console: Console,
) -> int:
    """Run every recording into a folder of its own, and print and write a summary.

    Recordings that an earlier start finished with the same request and configuration are not run
    again. One that fails stops no other. `workers` are the number of jobs, each a thread that waits
    for a process of its own, and the address of a Dask scheduler, whose workers see the same files.
    Returns the largest exit status of all runs.

    Raises
    ------
    InputError
        If two recordings have one name, or the cluster cannot be reached.
    """
    named = _named(requests)
    make_folder(folder)
    (folder / "config.yaml").write_text(configuration_text(configuration), encoding="utf-8")
    outcomes = {
        name: outcome
        for name, outcome in read_summary(folder).items()
        if name in named and _is_done(outcome, folder / name, named[name], configuration)
    }
    for name in outcomes:
        console.print(f"{name}: finished by an earlier start", highlight=False)
    tasks = [
        (name, arguments(request, folder, name, plots), str(folder.absolute()))
        for name, request in named.items()
        if name not in outcomes
    ]
    for outcome in in_order(run_one, tasks, *workers, pool=ThreadPoolExecutor):
        outcomes[outcome.name] = outcome
        _write_summary(folder, outcomes)
        console.print(f"{outcome.name}: {outcome.said}", highlight=False)
    ordered = [outcomes[name] for name in named]
    print_table(console, summary_table(ordered, folder))
    console.print(f"results: {folder}")
    return max(outcome.status for outcome in ordered)


def _named(requests: Sequence[Request]) -> dict[str, Request]:
    """Return the requests by the recordings' names.

    Raises
    ------
    InputError
        If two recordings have one name.
    """
    names = [Path(request.recording).stem for request in requests]
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise InputError(f"{name}: {count} recordings have this name; run them one by one")
    return dict(zip(names, requests, strict=True))


def arguments(request: Request, folder: Path, name: str, plots: str) -> list[str]:
    """Return the arguments of `gpvo` that run one recording."""
    options = {
        "--calibration": request.calibration,
        "--ground-truth": request.ground_truth,
        "--output": (folder / name).absolute(),
        "--config": (folder / "config.yaml").absolute(),
        "--start": request.start,
        "--duration": request.duration,
        "--left-topic": request.left_topic,
        "--right-topic": request.right_topic,
        "--right-offset": request.right_offset,
        "--plots": plots,
    }
    given = [f"{option}={value}" for option, value in options.items() if value is not None]
    return ["run", request.recording, *given]


def _is_done(
    outcome: Outcome, folder: Path, request: Request, configuration: Configuration
) -> bool:
    """Check that a recording was run to its end, with what is asked for now."""
    if outcome.status not in FINISHED or not (folder / COST_FILE).exists():
        return False
    try:
        return read_provenance(folder) == (request, configuration)
    except InputError:
        return False


def read_summary(folder: Path) -> dict[str, Outcome]:
    """Read the outcomes of an earlier start by name; none if there is no summary."""
    path = folder / SUMMARY
    if not path.exists():
        return {}
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        return {name: Outcome(name, each["status"], each["said"]) for name, each in facts.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is not what `gpvo run` wrote ({error}); remove it") from error


def _write_summary(folder: Path, outcomes: dict[str, Outcome]) -> None:
    facts = {name: {"status": each.status, "said": each.said} for name, each in outcomes.items()}
    with whole_file(folder / SUMMARY) as file:
        file.write((json.dumps(facts, indent=2) + "\n").encode())


def summary_table(outcomes: Sequence[Outcome], folder: Path) -> ResultTable:
    """Return a table with a row for each recording."""
    headings = ("recording", "verdict", "ATE m", "duration s", "x real time", "exit status")
    rows = tuple(tuple(map(Cell, _row(outcome, folder / outcome.name))) for outcome in outcomes)
    return ResultTable("Recordings", headings, rows)


def _row(outcome: Outcome, folder: Path) -> tuple[str, ...]:
    if outcome.status not in FINISHED:
        return outcome.name, "not finished", "", "", "", str(outcome.status)
    metrics, cost = (
        json.loads((folder / name).read_text(encoding="utf-8"))
        for name in ("metrics.json", COST_FILE)
    )
    errors = metrics["errors"]
    return (
        outcome.name,
        metrics["run"]["verdict"],
        f"{errors['ate']['se3']['translation']['rmse']:.4f}" if errors else "",
        f"{cost['recording_seconds']:.1f}",
        f"{cost['real_time_factor']:.2f}",
        str(outcome.status),
    )
