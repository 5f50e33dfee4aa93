"""Summary of many runs: mean and spread, and a file to compare later runs with."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gpvo.errors import InputError
from gpvo.evaluation.report.run_time import Cost
from gpvo.evaluation.report.table import Cell, ResultTable
from gpvo.trajectory.whole_file import whole_file

RELEVANT = 0.05
"""Smallest relative change of a mean that is called better or worse."""


@dataclass(frozen=True)
class CaseResult:
    """Result of one run of one case; NaN where there is no estimate or no meaningful number.

    Attributes
    ----------
    case, seed
        Case and seed of the run.
    final_percent
        Final translation error as a percentage of the path.
    rms_m, rms_deg
        Global translation (metres) and rotation (degrees) error.
    relative
        RMS SE(3) error of steps of 0.01 s.
    covered
        Fraction of the recording that has a trajectory, 0 to 1.
    real_time
        Seconds of the recording processed in a second.
    cost
        Cost of the run, by stage.
    failure
        Reason why there is no trajectory; empty if there is one.
    """

    case: str
    seed: int
    final_percent: float = np.nan
    rms_m: float = np.nan
    rms_deg: float = np.nan
    relative: float = np.nan
    covered: float = 0.0
    real_time: float = np.nan
    cost: Cost | None = None
    failure: str = ""

    def line(self) -> str:
        """Format the result in one line."""
        errors = f"{1e3 * self.rms_m:.1f} mm and {self.rms_deg:.2f}° RMS"
        speed = f"{self.real_time:.2f} x real time"
        return f"{self.case}, seed {self.seed}: {self.failure or f'{errors}, {speed}'}"


class Metric(NamedTuple):
    """A column: field of `CaseResult`, heading, factor, decimals, and which way is better."""

    field: str
    heading: str
    scale: float
    decimals: int
    more_is_better: bool = False


METRICS = (
    Metric("final_percent", "final [%]", 1.0, 2),
    Metric("rms_m", "error [mm]", 1e3, 1),
    Metric("rms_deg", "error [°]", 1.0, 2),
    Metric("relative", "step error [1e-3]", 1e3, 2),
    Metric("covered", "covered [%]", 100.0, 1, more_is_better=True),
    Metric("real_time", "x real time", 1.0, 2, more_is_better=True),
)


def values(results: Sequence[CaseResult], case: str, metric: Metric) -> dict[int, float]:
    """Return the finite numbers of a case by seed."""
    pairs = ((one.seed, getattr(one, metric.field)) for one in results if one.case == case)
    return {seed: value for seed, value in pairs if np.isfinite(value)}


def names(results: Sequence[CaseResult]) -> list[str]:
    """Return the names of the cases, each once, in order."""
    return list(dict.fromkeys(one.case for one in results))


def summary_table(results: Sequence[CaseResult]) -> ResultTable:
    """Return a table of mean and standard deviation over the seeds, one row per case."""
    seeds = len({one.seed for one in results})
    rows = [
        (Cell(case), *(Cell(spread_text(values(results, case, one), one)) for one in METRICS))
        for case in names(results)
    ]
    headings = ("case", *(metric.heading for metric in METRICS))
    title = (
        f"Simulated recordings, mean ± spread over {seeds} seeds: final error in percent of the"
        " path, RMS of the global error, RMS of the SE(3) error of steps of 0.01 s"
    )
    return ResultTable(title, headings, tuple(rows))


def spread_text(by_seed: Mapping[int, float], metric: Metric) -> str:
    """Format mean ± standard deviation."""
    if not by_seed:
        return "–"
    numbers = metric.scale * np.array(list(by_seed.values()))
    return f"{numbers.mean():.{metric.decimals}f} ± {numbers.std():.{metric.decimals}f}"


def comparison_table(results: Sequence[CaseResult], earlier: Sequence[CaseResult]) -> ResultTable:
    """Return a table of the changes, on the seeds that both have run."""
    rows = []
    for case in names(results):
        pairs = ((values(results, case, one), values(earlier, case, one), one) for one in METRICS)
        rows.append((Cell(case), *(Cell(change_text(*pair)) for pair in pairs)))
    headings = ("case", *(metric.heading for metric in METRICS))
    return ResultTable(
        "Compared with the earlier summary of the same recordings", headings, tuple(rows)
    )


def change_text(now: Mapping[int, float], then: Mapping[int, float], metric: Metric) -> str:
    """Format the relative change of the mean; it is better or worse only if every seed agrees."""
    common = sorted(now.keys() & then.keys())
    if not common:
        return "lost" if then else ("new" if now else "–")
    change = np.array([now[seed] - then[seed] for seed in common])
    before = np.mean([then[seed] for seed in common])
    if before == 0.0:
        return "same" if not change.any() else f"{metric.scale * change.mean():+.3g}"
    relative = float(change.mean() / before)
    agreed = (change > 0.0).all() or (change < 0.0).all()
    if abs(relative) < RELEVANT or not agreed:
        return f"{100.0 * relative:+.0f} %"
    better = (relative > 0.0) == metric.more_is_better
    return f"{100.0 * relative:+.0f} % {'better' if better else 'worse'}"


def write_summary(path: Path, results: Sequence[Any], facts: Mapping[str, Any]) -> None:
    """Write all results, which are dataclasses, with their configuration and simulations.

    A file that is there is replaced as a whole: it stays readable when the run is killed.
    """
    rows = [{name: _plain(value) for name, value in asdict(result).items()} for result in results]
    text = json.dumps({**facts, "results": rows}, indent=2)
    with whole_file(path) as file:
        file.write(f"{text}\n".encode())


def _plain(value: object) -> object:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def read_summary(path: Path, simulations: Mapping[str, Any] | None = None) -> list[CaseResult]:
    """Read the results of an earlier summary.

    Parameters
    ----------
    simulations
        Fields of the simulation of every case, like those in the summary; results of cases with
        other fields are left out.

    Raises
    ------
    InputError
        If the file is not a summary.
    """
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
        results = [_result(row) for row in summary["results"]]
        if simulations is None:
            return results
        then = summary["simulations"]
        return [one for one in results if simulations.get(one.case) == then[one.case]]
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is no summary of benchmarks.simulated ({error})") from error


def _result(row: Mapping[str, Any]) -> CaseResult:
    fields: dict[str, Any] = {key: np.nan if value is None else value for key, value in row.items()}
    fields["cost"] = None if row["cost"] is None else Cost(**row["cost"])
    return CaseResult(**fields)
