"""What was lost on long recordings, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.simulated_summary import Metric
from gpvo.evaluation.report.table import Cell, ResultTable


@dataclass(frozen=True)
class DriftResult:
    """Result of one recording, estimated in one way; NaN where there is none.

    Attributes
    ----------
    case, seed, variant
        Recording and row of the ablation.
    final_percent
        Final translation error as a percentage of the path.
    rms, ate
        Translation error with first poses aligned, and aligned by least squares, metres RMS.
    translation_per_metre, rotation_per_metre, translation_per_second, rotation_per_second
        Drift over half of the path or of the time, metres and radians, RMS.
    in_view
        Median time from a landmark's first measurement to its last one, seconds.
    nees
        NEES of the last pose per degree of freedom; 1 on average if consistent.
    last_round, last_round_by_first
        ATE of a loop's last round over the first one's, aligned as a whole, and by the first.
    failure
        Reason why there is no trajectory; empty if there is one.
    """

    case: str
    seed: int
    variant: str
    final_percent: float = np.nan
    rms: float = np.nan
    ate: float = np.nan
    translation_per_metre: float = np.nan
    rotation_per_metre: float = np.nan
    translation_per_second: float = np.nan
    rotation_per_second: float = np.nan
    in_view: float = np.nan
    nees: float = np.nan
    last_round: float = np.nan
    last_round_by_first: float = np.nan
    failure: str = ""

    def line(self) -> str:
        """Format the result in one line."""
        errors = f"final {self.final_percent:.2f} %, {1e3 * self.rms:.1f} mm RMS"
        if np.isfinite(self.last_round):
            errors += f", last round {self.last_round:.2f} times the first"
        return f"{self.case}, seed {self.seed}, {self.variant}: {self.failure or errors}"


METRICS = (
    Metric("final_percent", "final [%]", 1.0, 2),
    Metric("rms", "RMS [mm]", 1e3, 1),
    Metric("ate", "ATE [mm]", 1e3, 1),
    Metric("translation_per_metre", "[mm/m]", 1e3, 2),
    Metric("rotation_per_metre", "[°/m]", np.degrees(1.0), 3),
    Metric("translation_per_second", "[mm/s]", 1e3, 2),
    Metric("rotation_per_second", "[°/s]", np.degrees(1.0), 3),
    Metric("in_view", "in view [s]", 1.0, 2),
    Metric("nees", "NEES / 6", 1.0, 1),
    Metric("last_round", "last round", 1.0, 2),
    Metric("last_round_by_first", "by the first", 1.0, 2),
)


def case_table(results: Sequence[DriftResult], case: str) -> ResultTable:
    """Return a table of means over the seeds of one recording, one row for each variant."""
    of_case = [one for one in results if one.case == case]
    variants = dict.fromkeys(one.variant for one in of_case)
    rows = [
        _row(variant, [one for one in of_case if one.variant == variant]) for variant in variants
    ]
    seeds = len({one.seed for one in of_case})
    title = f"{case}, mean of {seeds} seeds" if seeds > 1 else f"{case}, one seed"
    headings = ("", *(metric.heading for metric in METRICS))
    return ResultTable(title, headings, tuple(rows))


def _row(variant: str, results: Sequence[DriftResult]) -> tuple[Cell, ...]:
    return (Cell(variant), *(Cell(_mean_text(results, metric)) for metric in METRICS))


def _mean_text(results: Sequence[DriftResult], metric: Metric) -> str:
    """Format the mean of the finite numbers."""
    numbers = np.array([getattr(one, metric.field) for one in results])
    known = numbers[np.isfinite(numbers)]
    return f"{metric.scale * known.mean():.{metric.decimals}f}" if len(known) else "–"
