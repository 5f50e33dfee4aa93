"""The paper's Tables I and II, and a table of evo's numbers, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from gpvo.evaluation.paper import COMPONENTS, Component

if TYPE_CHECKING:
    from gpvo.evaluation.evaluate import Evaluation

COMPONENT_LABELS: dict[Component, str] = {
    "translation": "tran. (m)",
    "rotation": "rota. (rad)",
    "se3": "SE(3)",
}


def global_error_table(evaluations: Sequence[Evaluation]) -> Table:
    """Error since the first pose, one row per estimate and component (the paper's Table I)."""
    table = _table("Global error, since the first pose", "max", "max %", "final %")
    for evaluation in evaluations:
        for component in COMPONENTS:
            numbers = evaluation.global_error.statistics(component)
            table.add_row(
                escape(evaluation.name) if component == COMPONENTS[0] else "",
                COMPONENT_LABELS[component],
                f"{numbers.max:.3f}",
                f"{numbers.max_percent:.2f} %",
                f"{numbers.final_percent:.2f} %",
                f"{numbers.rms:.3f}",
                f"{numbers.std:.3f}",
            )
        table.add_section()
    return table


def relative_error_table(evaluations: Sequence[Evaluation]) -> Table:
    """Error from state to state, one row per estimate and component (the paper's Table II)."""
    table = _table("Relative error, from state to state", "max")
    for evaluation in evaluations:
        for component in COMPONENTS:
            numbers = evaluation.relative_error.statistics(component)
            table.add_row(
                escape(evaluation.name) if component == COMPONENTS[0] else "",
                COMPONENT_LABELS[component],
                *(f"{1e3 * value:.2f}e-3" for value in (numbers.max, numbers.rms, numbers.std)),
            )
        table.add_section()
    return table


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("estimate")
    table.add_column("")
    for heading in (*headings, "RMS", "st. dev."):
        table.add_column(heading, justify="right")
    return table


def summary_table(evaluations: Sequence[Evaluation]) -> Table:
    """ATE and RPE (RMSE), path length and coverage, one column per estimate."""
    table = Table(title="Trajectory error (RMSE)", title_justify="left")
    table.add_column("")
    for evaluation in evaluations:
        table.add_column(escape(evaluation.name), justify="right")
    columns = [_summary(evaluation) for evaluation in evaluations]
    for label in columns[0]:
        table.add_row(label, *(column[label] for column in columns))
    return table


def _summary(evaluation: Evaluation) -> dict[str, str]:
    ate, rpe = evaluation.ate, evaluation.rpe
    return {
        "ATE, SE(3) aligned": f"{ate['se3'].translation.rmse:.3f} m",
        "ATE, yaw aligned": f"{ate['yaw'].translation.rmse:.3f} m",
        "ATE, first pose aligned": f"{ate['first'].translation.rmse:.3f} m",
        "RPE over 1 s": f"{rpe['1 s'].translation.rmse:.3f} m",
        "RPE over 1 s, rotation": f"{rpe['1 s'].rotation.rmse:.4f} rad",
        "RPE over 1 m": f"{rpe['1 m'].translation.rmse:.3f} m",
        "path length": f"{evaluation.path_length:.2f} m",
        "ground truth covered": f"{100 * evaluation.coverage:.1f} %",
    }
