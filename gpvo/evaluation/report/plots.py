"""Figures of paths and errors.

The world frame of every plot is the first camera: x to the right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from numpy.typing import ArrayLike, NDArray

from factors.lie import se3_inverse
from gpvo.evaluation.evaluate import Evaluation
from gpvo.evaluation.report.figures import (
    COLOURS,
    TRUTH_COLOUR,
    label_axes,
    line_styles,
    new_figure,
    shared_legend,
)
from gpvo.evaluation.report.weak_stretches import ShadedStretch
from gpvo.trajectory import StampedPoses


def path_figure(estimates: Mapping[str, StampedPoses], ground_truth: StampedPoses | None) -> Figure:
    """Draw paths from above and from the side.

    Estimates must be in the ground truth's world, like those of an `Evaluation`. The origin is the
    first true pose, or the first estimate's first pose if there is no ground truth.
    """
    figure = new_figure(9.0, 4.6)
    above, side = figure.subplots(1, 2)
    for name, positions, style in _paths(estimates, ground_truth):
        x, y, z = positions.T
        above.plot(x, z, label=name, **style)
        side.plot(z, -y, label=name, **style)
    for axes, title in ((above, "from above"), (side, "from the side")):
        axes.plot(0.0, 0.0, "o", color="black", markersize=4, zorder=5)
        axes.set_title(title)
        axes.set_aspect("equal", adjustable="datalim")
    label_axes(above, "right [m]", "forward [m]")
    label_axes(side, "forward [m]", "up [m]")
    shared_legend(figure, above)
    return figure


def path_figure_3d(
    estimates: Mapping[str, StampedPoses], ground_truth: StampedPoses | None
) -> Figure:
    """Draw paths in space, height upwards, in the frame of `path_figure`."""
    figure = new_figure(6.4, 4.8)
    axes = figure.add_subplot(projection="3d", elev=22.0, azim=-60.0)
    for name, positions, style in _paths(estimates, ground_truth):
        x, y, z = positions.T
        axes.plot(x, z, -y, label=name, **style)
    axes.plot([0.0], [0.0], [0.0], "o", color="black", markersize=4)
    axes.set(xlabel="right [m]", ylabel="forward [m]", zlabel="up [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_box_aspect(None, zoom=0.95)
    shared_legend(figure, axes)
    return figure


def _paths(
    estimates: Mapping[str, StampedPoses], ground_truth: StampedPoses | None
) -> Iterable[tuple[str, np.ndarray, dict]]:
    first = next(iter(estimates.values())) if ground_truth is None else ground_truth
    T_first_world = se3_inverse(first.T_world_cam[0])
    if ground_truth is not None:
        style = {"color": TRUTH_COLOUR, "linewidth": 2.2}
        yield "ground truth", ground_truth.in_world(T_first_world).positions, style
    for (name, poses), style in zip(estimates.items(), line_styles(len(estimates)), strict=True):
        yield name, poses.in_world(T_first_world).positions, {**style, "linewidth": 1.4}


def error_figure(
    evaluations: Sequence[Evaluation],
    over: str = "time",
    stretches: Sequence[ShadedStretch] = (),
    deviations: NDArray[np.float64] | None = None,
    start_ns: int | None = None,
) -> Figure:
    """Draw global translation and rotation error and relative SE(3) error, one above the other.

    Parameters
    ----------
    evaluations
        Evaluations of one sequence.
    over
        "time", or "path" length travelled by the ground truth.
    stretches
        Stretches to shade behind the curves.
    deviations
        (N, 2) standard deviations of the first estimate's rotation, rad, and position, m, of which
        bands of three are drawn.
    start_ns
        Absolute stamp of time zero; by default that of the first pose compared.
    """
    figure = new_figure(8.0, 6.6)
    translation, rotation, relative = figure.subplots(3, 1, sharex=True)
    zero_ns = min(int(one.estimate.stamps_ns[0]) for one in evaluations)
    zero_ns = zero_ns if start_ns is None else start_ns
    for evaluation, style in zip(evaluations, line_styles(len(evaluations)), strict=True):
        along = _along(evaluation, over, zero_ns)
        label, norms = evaluation.name, evaluation.global_error.norms
        translation.plot(along, norms["translation"], label=label, **style)
        rotation.plot(along, np.degrees(norms["rotation"]), **style)
        step = np.maximum(evaluation.relative_error.norms["se3"], 1e-12)
        relative.semilogy(along[1:], step, linewidth=0.8, **style)
    _shade((translation, rotation, relative), evaluations[0], over, stretches, zero_ns)
    if deviations is not None:
        along = _along(evaluations[0], over, zero_ns)
        bands = 3 * deviations[:, 1], np.degrees(3 * deviations[:, 0])
        for axes, band in zip((translation, rotation), bands, strict=True):
            axes.fill_between(along, band, color=COLOURS[5], alpha=0.25, linewidth=0, label="3 σ")
    label_axes(translation, "", "global translation\nerror [m]")
    label_axes(rotation, "", "global rotation\nerror [°]")
    time = "time since the first pose compared [s]" if start_ns is None else "time [s]"
    label_axes(
        relative, "path length [m]" if over == "path" else time, "relative SE(3)\nerror [m, rad]"
    )
    for axes in (translation, rotation):
        axes.set_ylim(bottom=0.0)
    _logarithmic_ticks(relative)
    relative.margins(x=0.01)
    shared_legend(figure, translation)
    return figure


def _along(evaluation: Evaluation, over: str, zero_ns: int) -> NDArray[np.float64]:
    """Return the distances or the times since `zero_ns` (N,) of an evaluation's poses."""
    if over == "path":
        return evaluation.distances
    return np.asarray((evaluation.estimate.stamps_ns - zero_ns) * 1e-9, np.float64)


def _logarithmic_ticks(axes: Axes) -> None:
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:.0e}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _shade(
    rows: Iterable[Axes],
    evaluation: Evaluation,
    over: str,
    stretches: Sequence[ShadedStretch],
    zero_ns: int,
) -> None:
    times, along = (_along(evaluation, each, zero_ns) for each in ("time", over))
    for stretch in stretches:
        ends = (np.array([stretch.start_ns, stretch.stop_ns]) - zero_ns) * 1e-9
        ends = np.interp(ends, times, along)
        for index, axes in enumerate(rows):
            label = stretch.label if index == 0 else None
            axes.axvspan(*ends, color=stretch.colour, alpha=0.2, linewidth=0, label=label)


def series_figure(
    seconds: ArrayLike,
    series: Mapping[str, ArrayLike],
    ylabel: str,
    shaded: Mapping[str, Sequence[tuple[float, float]]] = MappingProxyType({}),
) -> Figure:
    """Draw whole numbers over the recording's time, for instance tracklets per cluster.

    `shaded` holds stretches of time to shade, seconds, by their label.
    """
    figure = new_figure(8.0, 3.2)
    axes = figure.subplots()
    for label, spans in shaded.items():
        for span in spans:
            axes.axvspan(*span, color=COLOURS[3], alpha=0.2, linewidth=0, label=label)
    for (name, values), style in zip(series.items(), line_styles(len(series)), strict=True):
        axes.plot(seconds, values, linewidth=1.0, label=name, **style)
    label_axes(axes, "time [s]", ylabel)
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.01)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    shared_legend(figure, axes)
    return figure
