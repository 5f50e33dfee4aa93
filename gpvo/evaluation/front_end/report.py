"""An inspection as a table, JSON, plots and pictures of tracklets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table

from gpvo.evaluation.front_end.inspect import SLOPE_AGREEMENT, InspectedCluster, JudgedTracklets
from gpvo.evaluation.front_end.summary import Numbers, velocity_errors
from gpvo.evaluation.report.figures import COLOURS, new_figure, save_figure, shared_legend
from gpvo.evaluation.report.plots import series_figure

FILES = ("inspection.json", "counts.png", "flow.png", "errors.png", "velocity.png", "tracklets.png")

PICTURES, COLUMNS, MAGNIFICATION = 9, 3, 2
FRAME = (150, 150, 150)
RIGHT, WRONG, LOST = (60, 160, 0), (0, 0, 230), (0, 150, 255)
"""Blue, green and red of the tracklets' colours."""
LEGEND = {
    RIGHT: "inlier that agrees with the true motion",
    WRONG: "inlier that does not",
    LOST: "outlier that agrees with it",
}


def write_inspection(
    folder: Path, clusters: Sequence[InspectedCluster], summary: dict[str, Numbers], width: int
) -> None:
    """Write all files into an existing folder; `width` is the image width in pixels."""
    plain = {
        stage: {name: value if isfinite(value) else None for name, value in numbers.items()}
        for stage, numbers in summary.items()
    }
    save_figure(_counts_figure(clusters), folder / "counts.png")
    save_figure(_flow_figure(clusters), folder / "flow.png")
    save_figure(_errors_figure(clusters), folder / "errors.png")
    save_figure(_velocity_figure(clusters), folder / "velocity.png")
    # cv2.imwrite says nothing of a full disk.
    _, picture = cv2.imencode(".png", tracklet_strip(clusters, width))
    (folder / "tracklets.png").write_bytes(picture.tobytes())
    (folder / "inspection.json").write_text(json.dumps(plain, indent=2) + "\n")


def inspection_table(summary: dict[str, Numbers]) -> Table:
    """Format the numbers as a table for the terminal."""
    table = Table()
    for heading in ("stage", "number", "value"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for stage, numbers in summary.items():
        for index, (name, value) in enumerate(numbers.items()):
            last = index == len(numbers) - 1
            table.add_row(stage if index == 0 else "", name, f"{value:.4g}", end_section=last)
    return table


def _counts_figure(clusters: Sequence[InspectedCluster]) -> Figure:
    counts = {
        "features": [c.features for c in clusters],
        "quad matches": [c.quads for c in clusters],
        "tracklets": [len(c.tracklets) for c in clusters],
        "inliers": [int(c.tracklets.accepted.sum()) for c in clusters],
        "true inliers": [int((c.tracklets.accepted & c.tracklets.agree).sum()) for c in clusters],
    }
    return series_figure(_middles(clusters), counts, "per cluster")


def _flow_figure(clusters: Sequence[InspectedCluster]) -> Figure:
    """Plot measured against true flow, and their difference."""
    tracklets = JudgedTracklets.concatenate(cluster.tracklets for cluster in clusters)
    near = tracklets.distance <= SLOPE_AGREEMENT
    figure = new_figure(8.0, 3.6)
    along, around = figure.subplots(1, 2)
    for axis, name in enumerate(("u", "v")):
        style = {"color": COLOURS[axis], "linestyle": "none", "marker": "."}
        true, measured = tracklets.true_flow[near, axis], tracklets.measured_flow[near, axis]
        along.plot(true, measured, markersize=1.5, **style)
        along.plot([], [], markersize=8.0, label=name, **style)
        around.plot(true, measured - true, markersize=1.5, **style)
    along.axline((0.0, 0.0), slope=1.0, color="black", linewidth=0.6)
    along.set(xlabel="true flow [px]", ylabel="measured flow [px]")
    around.set(xlabel="true flow [px]", ylabel="measured minus true [px]")
    shared_legend(figure, along)
    return figure


def _errors_figure(clusters: Sequence[InspectedCluster]) -> Figure:
    """Plot histograms of the inliers' errors."""
    tracklets = JudgedTracklets.concatenate(cluster.tracklets for cluster in clusters)
    inliers = tracklets.accepted & tracklets.agree
    figure = new_figure(9.0, 3.0)
    panels = {
        "column and row error [px]": tracklets.error[inliers, :2].ravel(),
        "disparity error [px]": tracklets.disparity_error[inliers],
        "time error [ms]": tracklets.time_error[inliers] * 1e3,
    }
    for axes, (name, values) in zip(figure.subplots(1, 3), panels.items(), strict=True):
        values = values[np.isfinite(values)]
        reach = max(1e-3, np.quantile(np.abs(values), 0.99)) if len(values) else 1.0
        axes.hist(values, bins=60, range=(-reach, reach), color=COLOURS[0])
        axes.set_xlabel(name)
        axes.set_yticks([])
    return figure


def _velocity_figure(clusters: Sequence[InspectedCluster]) -> Figure:
    """Plot the velocity errors of both versions of MC-RANSAC over time."""
    figure = new_figure(8.0, 4.2)
    angular, linear = figure.subplots(2, 1, sharex=True)
    for name, colour in zip(("fast", "iterative"), COLOURS, strict=False):
        error = velocity_errors(clusters, name)
        for axes, part in ((angular, error[:, :3]), (linear, error[:, 3:])):
            norm = np.linalg.norm(part, axis=1)
            axes.semilogy(_middles(clusters), norm, color=colour, linewidth=1.0, label=name)
    angular.set_ylabel("angular velocity\nerror [rad/s]")
    linear.set(xlabel="time [s]", ylabel="linear velocity\nerror [m/s]")
    shared_legend(figure, angular)
    return figure


def _middles(clusters: Sequence[InspectedCluster]) -> list[float]:
    return [0.5 * (cluster.start + cluster.stop) for cluster in clusters]


def tracklet_strip(clusters: Sequence[InspectedCluster], width: int) -> NDArray[np.uint8]:
    """Draw a colour image of a few clusters, evenly spread, with their tracklets."""
    chosen = np.unique(np.linspace(0, len(clusters) - 1, PICTURES).astype(int))
    pictures = [tracklet_picture(clusters[index], width) for index in chosen]
    blank = np.full_like(pictures[0], 255)
    pictures += [blank] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[i : i + COLUMNS]) for i in range(0, len(pictures), COLUMNS)]
    return np.vstack([_legend(rows[0].shape[1]), *rows])


def _legend(width: int) -> NDArray[np.uint8]:
    """Draw the legend of the colours, one per line."""
    line = 22
    legend = np.full((line * len(LEGEND), width, 3), 255, np.uint8)
    for index, (colour, text) in enumerate(LEGEND.items()):
        centre = line * index + line // 2
        cv2.circle(legend, (12, centre), 4, colour, cv2.FILLED, cv2.LINE_AA)
        _write(legend, text, (26, centre + 5))
    return legend


def tracklet_picture(cluster: InspectedCluster, width: int) -> NDArray[np.uint8]:
    """Draw the left binary frame in grey, and tracklets from their first point in the span."""
    white = np.unpackbits(cluster.picture, axis=1, count=width)
    grey = np.kron(255 - 70 * white, np.ones((MAGNIFICATION, MAGNIFICATION), np.uint8))
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    tracklets = cluster.tracklets
    for colour, mask in (
        (LOST, ~tracklets.accepted & tracklets.agree),
        (RIGHT, tracklets.accepted & tracklets.agree),
        (WRONG, tracklets.accepted & ~tracklets.agree),
    ):
        ends = (tracklets.earlier.stereo[mask, :2], tracklets.later.stereo[mask, :2])
        for first, last in zip(*(_magnified(end) for end in ends), strict=True):
            cv2.line(picture, first, last, colour, 1, cv2.LINE_AA)
            cv2.circle(picture, last, 2, colour, cv2.FILLED, cv2.LINE_AA)
    _write(picture, f"{cluster.stop:.3f} s", (6, 16))
    return cv2.rectangle(picture, (0, 0), (picture.shape[1], picture.shape[0]), FRAME)


def _magnified(points: NDArray[np.float64]) -> list[tuple[int, int]]:
    return [(int(u), int(v)) for u, v in np.rint((points + 0.5) * MAGNIFICATION)]


def _write(picture: NDArray[np.uint8], text: str, corner: tuple[int, int]) -> None:
    cv2.putText(picture, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
