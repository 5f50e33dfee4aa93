"""Plot of the suite's results: every seed is a point, every mean a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from benchmarks.simulated_summary import METRICS, CaseResult, Metric, names, values
from gpvo.evaluation.report.figures import COLOURS, new_figure, shared_legend

SHOWN = ("rms_m", "rms_deg", "relative", "real_time")


def suite_figure(results: Sequence[CaseResult], earlier: Sequence[CaseResult] = ()) -> Figure:
    """Draw errors and speed by case, beside those of an earlier run if given."""
    cases = names(results)
    metrics = [metric for metric in METRICS if metric.field in SHOWN]
    figure = new_figure(max(4.0, 1.5 + 0.9 * len(cases)), 2.0 * len(metrics))
    rows = figure.subplots(len(metrics), 1, sharex=True, squeeze=False)[:, 0]
    runs = [("earlier", earlier), ("now", results)] if earlier else [("each seed", results)]
    for axes, metric in zip(rows, metrics, strict=True):
        for number, ((label, run), colour) in enumerate(zip(runs, COLOURS, strict=False)):
            _draw(axes, run, cases, metric, 0.2 * (number - 0.5 * (len(runs) - 1)), label, colour)
        axes.set_ylabel(metric.heading.replace(" [", "\n["))
        if metric.more_is_better:
            axes.set_ylim(bottom=0.0)
        else:
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    rows[-1].set_xticks(range(len(cases)), [case.replace("_", "\n") for case in cases])
    shared_legend(figure, rows[0])
    return figure


def _draw(
    axes: Axes,
    results: Sequence[CaseResult],
    cases: Sequence[str],
    metric: Metric,
    shift: float,
    label: str,
    colour: str,
) -> None:
    for number, case in enumerate(cases):
        numbers = metric.scale * np.array(list(values(results, case, metric).values()))
        if len(numbers) == 0:
            continue
        at = number + shift
        axes.plot(np.full(len(numbers), at), numbers, "o", color=colour, markersize=4, label=label)
        axes.plot([at - 0.1, at + 0.1], [numbers.mean()] * 2, color=colour, linewidth=2.0)
