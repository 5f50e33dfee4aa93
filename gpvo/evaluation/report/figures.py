"""The look of all figures: colours, legends, and files, the same bytes for the same input."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

TRUTH_COLOUR = "#555555"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Palette of M. Okabe and K. Ito, distinguishable for colour-blind readers too."""
DASHES = ("-", "--", ":", "-.")
"""Line styles, one after the other where the palette repeats."""
MOST_COLUMNS = 5
"""Largest number of columns of a legend."""


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure, sizes in inches, without a window."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def line_styles(count: int) -> list[dict[str, Any]]:
    """Return `count` colours with line styles, all different up to two dozen."""
    return [
        {
            "color": COLOURS[index % len(COLOURS)],
            "linestyle": DASHES[index // len(COLOURS) % len(DASHES)],
        }
        for index in range(count)
    ]


def shared_legend(figure: Figure, axes: Axes) -> None:
    """Add one legend above all axes, with each label of `axes` once, in columns that fit."""
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    for columns in range(min(MOST_COLUMNS, len(entries)), 0, -1):
        legend = figure.legend(
            entries.values(),
            entries.keys(),
            loc="outside upper center",
            ncols=columns,
            frameon=False,
        )
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Label axes, and draw a light grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def png(figure: Figure) -> bytes:
    """Return a PNG without date or version, so that equal figures give equal files."""
    memory = BytesIO()
    figure.savefig(memory, dpi=150, format="png", metadata={"Software": None})
    return memory.getvalue()


def save_figure(figure: Figure, path: Path | str) -> None:
    """Write a figure as a PNG, PDF or SVG file, by its name, without a date."""
    kind = Path(path).suffix[1:]
    if kind == "png":
        Path(path).write_bytes(png(figure))
        return
    no_date: dict[str, Any] = {"CreationDate": None} if kind == "pdf" else {"Date": None}
    with rc_context({"svg.hashsalt": "gpvo"}):
        figure.savefig(path, format=kind, metadata=no_date)
