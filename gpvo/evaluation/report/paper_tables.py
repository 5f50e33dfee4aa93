"""The paper's Tables I and II and a table of ATE and RPE, independent of the output format."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gpvo.evaluation.evaluate import Evaluation
from gpvo.evaluation.metrics.paper_errors import COMPONENTS, Component, PaperStatistics
from gpvo.evaluation.report.table import Cell, ResultTable

COMPONENT_LABELS: dict[Component, str] = {
    "translation": "tran. (m)",
    "rotation": "rota. (rad)",
    "se3": "SE(3) (m, rad)",
}


@dataclass(frozen=True)
class ErrorRow:
    """Errors of one estimate for the paper's tables, evaluated here or published elsewhere."""

    name: str
    global_error: dict[Component, PaperStatistics]
    relative_error: dict[Component, PaperStatistics]

    @staticmethod
    def of(evaluation: Evaluation) -> ErrorRow:
        """Return the row of an evaluation."""
        return ErrorRow(
            evaluation.name,
            {part: evaluation.global_error.statistics(part) for part in COMPONENTS},
            {part: evaluation.relative_error.statistics(part) for part in COMPONENTS},
        )


Column = tuple[str, Callable[[PaperStatistics], float], Callable[[float], str]]


def fixed(value: float) -> str:
    """Format a number with three decimals."""
    return f"{value:.3f}"


def percent(value: float) -> str:
    """Format a percentage with two decimals."""
    return f"{value:.2f} %"


def thousandths(value: float) -> str:
    """Format a number in thousandths with two decimals, like the paper's relative errors."""
    return f"{1e3 * value:.2f}e-3"


GLOBAL_COLUMNS: tuple[Column, ...] = (
    ("max", lambda numbers: numbers.max, fixed),
    ("max %", lambda numbers: numbers.max_percent, percent),
    ("final %", lambda numbers: numbers.final_percent, percent),
    ("RMS", lambda numbers: numbers.rms, fixed),
    ("st. dev.", lambda numbers: numbers.std, fixed),
)
RELATIVE_COLUMNS: tuple[Column, ...] = (
    ("max", lambda numbers: numbers.max, thousandths),
    ("RMS", lambda numbers: numbers.rms, thousandths),
    ("st. dev.", lambda numbers: numbers.std, thousandths),
)


def evaluation_tables(evaluation: Evaluation) -> list[ResultTable]:
    """Return the paper's tables and the summary of one estimate."""
    rows = [ErrorRow.of(evaluation)]
    return [global_error_table(rows), relative_error_table(rows), summary_table([evaluation])]


def global_error_table(rows: Sequence[ErrorRow], sequence: str = "") -> ResultTable:
    """Return the paper's Table I: error since the first pose, by estimate and component."""
    title = f"{sequence}: global error" if sequence else "Global error, since the first pose"
    return _error_table(title, [(row.name, row.global_error) for row in rows], GLOBAL_COLUMNS)


def relative_error_table(rows: Sequence[ErrorRow], sequence: str = "") -> ResultTable:
    """Return the paper's Table II: error from state to state, by estimate and component."""
    title = f"{sequence}: relative error" if sequence else "Relative error, from state to state"
    return _error_table(title, [(row.name, row.relative_error) for row in rows], RELATIVE_COLUMNS)


def _error_table(
    title: str,
    named: Sequence[tuple[str, dict[Component, PaperStatistics]]],
    columns: Sequence[Column],
) -> ResultTable:
    rows: list[list[Cell]] = []
    for name, _ in named:
        for part in COMPONENTS:
            label = name if part == COMPONENTS[0] else ""
            rows.append([Cell(label), Cell(COMPONENT_LABELS[part])])
    for offset, part in enumerate(COMPONENTS):
        for _, pick, text in columns:
            cells = best_marked([pick(errors[part]) for _, errors in named], text)
            for index, cell in enumerate(cells):
                rows[index * len(COMPONENTS) + offset].append(cell)
    headings = ("estimate", "", *(heading for heading, _, _ in columns))
    return ResultTable(title, headings, tuple(map(tuple, rows)), group=len(COMPONENTS))


def best_marked(values: Sequence[float], text: Callable[[float], str]) -> list[Cell]:
    """Return the cells of competing values; the smallest and those of equal text are best."""
    cells = [Cell(text(value) if math.isfinite(value) else "–") for value in values]
    finite = [value for value in values if math.isfinite(value)]
    if len(finite) < 2:
        return cells
    best = text(min(finite))
    return [replace(cell, best=cell.text == best) for cell in cells]


def summary_table(evaluations: Sequence[Evaluation], sequence: str = "") -> ResultTable:
    """Return a table of ATE and RPE (RMSE), drift, path and coverage, one column per estimate."""
    rows = []
    for label, pick, text in SUMMARY_ROWS:
        cells = best_marked([pick(evaluation) for evaluation in evaluations], text)
        rows.append((Cell(label), *cells))
    for label, describe in PLAIN_ROWS:
        plain = (Cell(describe(evaluation)) for evaluation in evaluations)
        rows.append((Cell(label), *plain))
    if not all(one.aligned_rotation_is_known for one in evaluations):
        known = (Cell(degrees(one.aligned_rotation_doubt)) for one in evaluations)
        rows.append((Cell("aligned rotation is known to"), *known))
    title = f"{sequence}: trajectory error (RMSE)" if sequence else "Trajectory error (RMSE)"
    return ResultTable(title, ("", *(one.name for one in evaluations)), tuple(rows), len(rows))


def metres(value: float) -> str:
    """Format metres with four decimals, 0.1 mm."""
    return f"{value:.4f} m"


def degrees(radians: float) -> str:
    """Format radians as degrees with two decimals."""
    return f"{math.degrees(radians):.2f}°"


SUMMARY_ROWS: tuple[tuple[str, Callable[[Evaluation], float], Callable[[float], str]], ...] = (
    ("ATE, SE(3) aligned", lambda one: one.ate["se3"].translation.rmse, metres),
    ("ATE, SE(3) aligned, rotation", lambda one: one.ate["se3"].rotation.rmse, degrees),
    ("ATE, yaw aligned", lambda one: one.ate["yaw"].translation.rmse, metres),
    ("ATE, first pose aligned", lambda one: one.ate["first"].translation.rmse, metres),
    ("RPE over 1 s", lambda one: one.rpe["1 s"].translation.rmse, metres),
    ("RPE over 1 s, rotation", lambda one: one.rpe["1 s"].rotation.rmse, degrees),
    ("RPE over 1 m", lambda one: one.rpe["1 m"].translation.rmse, metres),
    ("drift over half the path", lambda one: one.drift_percent, percent),
)
PLAIN_ROWS: tuple[tuple[str, Callable[[Evaluation], str]], ...] = (
    ("scale that fits best", lambda one: f"{one.ate['sim3'].scale:.3f}"),
    ("path length", lambda one: f"{one.path_length:.2f} m"),
    ("poses compared", lambda one: f"{one.ate['se3'].translation.count}"),
    ("ground truth covered", lambda one: f"{100 * one.coverage:.1f} %"),
)
