"""Report of comparisons on disk: tables, numbers, figures and one HTML page with all of them."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gpvo.evaluation.comparison import Comparison
from gpvo.evaluation.report.figures import png
from gpvo.evaluation.report.plots import error_figure, path_figure, path_figure_3d
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.table import LATEX_PACKAGES, to_html, to_latex, to_markdown
from gpvo.trajectory import StampedPoses

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; margin: 1.5rem 0; font-variant-numeric: tabular-nums }
caption { text-align: left; font-weight: 600; padding-bottom: .4rem }
th, td { padding: .2rem .9rem; text-align: right }
th:first-child, td:first-child { text-align: left; padding-left: 0 }
thead tr, tr.last { border-bottom: 1px solid #999 }
img { max-width: 100%; height: auto; display: block; margin: 1rem 0 }
.note { color: #555 }
"""


def write_report(directory: Path, comparisons: Sequence[Comparison]) -> None:
    """Write metrics.json, tables.md, tables.tex, report.html and a folder of PNGs per sequence.

    Raises
    ------
    InputError
        If a folder cannot be made.
    """
    make_folder(directory)
    numbers = [comparison.to_dict() for comparison in comparisons]
    _write(directory / "metrics.json", json.dumps(numbers, indent=2) + "\n")
    tables = [table for comparison in comparisons for table in comparison.tables()]
    _write(directory / "tables.md", "\n".join(map(to_markdown, tables)))
    latex = [f"% {LATEX_PACKAGES}\n", *map(to_latex, tables)]
    _write(directory / "tables.tex", "\n".join(latex))
    sections = []
    for comparison in comparisons:
        images = {name: png(figure) for name, figure in comparison_figures(comparison).items()}
        folder = make_folder(directory / comparison.sequence)
        for name, image in images.items():
            (folder / f"{name}.png").write_bytes(image)
        sections.append(_html_section(comparison, images))
    _write(directory / "report.html", _html_page("\n".join(sections)))


def _write(path: Path, text: str) -> None:
    path.write_bytes(text.encode("utf-8"))


def comparison_figures(comparison: Comparison) -> dict[str, Figure]:
    """Draw the paper's figures: path in space and from two sides, errors over path and time."""
    evaluations = comparison.evaluations
    estimates = {evaluation.name: evaluation.estimate for evaluation in evaluations}
    ground_truth = _joined([evaluation.ground_truth for evaluation in evaluations])
    return {
        "path_3d": path_figure_3d(estimates, ground_truth),
        "path": path_figure(estimates, ground_truth),
        "error_over_path": error_figure(evaluations, "path", comparison.stretches),
        "error_over_time": error_figure(evaluations, "time", comparison.stretches),
    }


def _joined(parts: Sequence[StampedPoses]) -> StampedPoses:
    """Merge the compared parts of the ground truth into one series, every stamp once."""
    stamps, first = np.unique(np.concatenate([part.stamps_ns for part in parts]), return_index=True)
    return StampedPoses(stamps, np.concatenate([part.T_world_cam for part in parts])[first])


def _html_section(comparison: Comparison, images: dict[str, bytes]) -> str:
    tables = "\n".join(map(to_html, comparison.tables()))
    notes = [*comparison.notes(), *comparison.warnings()]
    note = "\n".join(f'<p class="note">{escape(text)}</p>' for text in notes)
    figures = "\n".join(_html_image(name, image) for name, image in images.items())
    return f"<h2>{escape(comparison.sequence)}</h2>\n{tables}\n{note}\n{figures}"


def _html_image(name: str, image: bytes) -> str:
    text, data = name.replace("_", " "), b64encode(image).decode("ascii")
    return f'<img alt="{text}" src="data:image/png;base64,{data}">'


def _html_page(body: str) -> str:
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>Trajectory evaluation</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n<h1>Trajectory evaluation</h1>\n{body}\n</body>\n</html>\n"
    )
