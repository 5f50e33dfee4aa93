"""Result of a run: trajectory, configuration, metrics and plots in one folder."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from gpvo.cluster_report import ClusterReport
from gpvo.config import Configuration, configuration_text
from gpvo.errors import OutputError
from gpvo.estimator import Diagnostic
from gpvo.evaluation import Evaluation, evaluate
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import COST_FILE
from gpvo.evaluation.report.weak_stretches import shaded_stretches
from gpvo.trajectory import StampedPoses, Trajectory, write_tum
from gpvo.trajectory.whole_file import whole_file
from gpvo.verdict import Verdict

PLOTS = ("path", "error", "tracklets", "overview")
FORMATS = ("png", "pdf", "svg")
FILES = (
    "trajectory.tum",
    "trajectory.npz",
    "ground_truth.tum",
    "metrics.json",
    "config.yaml",
    *(f"{name}.{kind}" for name in PLOTS for kind in FORMATS),
    "map.npz",
    "map.ply",
    "scene.npz",
    COST_FILE,
    "run.json",
)
STEP = 0.01
"""Seconds between the poses that are compared with the ground truth."""


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a finished run, with its errors if there is a ground truth.

    `streams` holds what was measured of the events.
    """

    trajectory: Trajectory
    reports: list[ClusterReport]
    diagnostics: list[Diagnostic]
    configuration: Configuration
    verdict: Verdict
    evaluation: Evaluation | None = None
    ground_truth: StampedPoses | None = None
    streams: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path | str, plots: str = "png", found: str = "") -> None:
        """Write what was found about a trajectory, which is saved before.

        `plots` is the plots' format, one of `FORMATS` or none; `found` follows the configuration.
        """
        folder = make_folder(folder)
        for name, text in (
            ("config.yaml", configuration_text(self.configuration) + found),
            ("metrics.json", json.dumps(self.metrics(), indent=2) + "\n"),
        ):
            with whole_file(folder / name) as file:
                file.write(text.encode())
        if self.ground_truth is not None:
            write_tum(folder / "ground_truth.tum", self.ground_truth)
        if plots != "none":
            self._write_plots(folder, plots)

    def metrics(self) -> dict[str, Any]:
        """Return the numbers of the run by name, except those of time spent."""
        run = {
            "start_s": self.trajectory.start,
            "stop_s": self.trajectory.stop,
            "states": len(self.trajectory),
            "clusters": len(self.reports),
            "clusters_without_inliers": sum(report.inliers == 0 for report in self.reports),
            "events": sum(report.events for report in self.reports),
            **self._left_out(),
            "measurements": sum(report.measurements for report in self.reports),
            "median_tracklets": float(np.median([report.tracklets for report in self.reports])),
            "median_inliers": float(np.median([report.inliers for report in self.reports])),
        }
        run |= self.verdict.to_dict()
        errors = None if self.evaluation is None else self.evaluation.to_dict()
        diagnostics = [diagnostic.to_dict() for diagnostic in self.diagnostics]
        streams = dict(self.streams)
        return {"run": run, "errors": errors, "streams": streams, "diagnostics": diagnostics}

    def _left_out(self) -> dict[str, Any]:
        """Return the numbers of noise, flashes and rest by name."""
        reports = self.reports
        durations = [report.stop - report.start for report in reports]
        background, hot = np.sum([report.left_out for report in reports], axis=0).tolist()
        between = sum(report.between for report in reports)
        all_events = sum(report.events for report in reports) + between + background + hot
        thinned = sum(report.tracking.thinned for report in reports if report.tracking)
        noise_rates = [report.noise_rate for report in reports]
        flashes = [report.flash for report in reports if report.flash > 0]
        rests = [d for d, report in zip(durations, reports, strict=True) if report.at_rest]
        return {
            "between_clusters_left_out_percent": 100 * between / max(all_events, 1),
            "thinned_percent": 100 * thinned / max(all_events, 1),
            "background_left_out_percent": 100 * background / max(all_events, 1),
            "hot_pixels_left_out_percent": 100 * hot / max(all_events, 1),
            "background_activity": float(np.average(noise_rates, weights=durations)),
            "flashes": len(flashes),
            "flashes_s": float(sum(flashes)),
            "at_rest_s": float(sum(rests)),
        }

    def table(self) -> Table:
        """Return a table that summarises the run."""
        run = self.metrics()["run"]
        duration = self.reports[-1].stop - self.reports[0].start
        rows = {
            "recording": f"{duration:.2f} s, {run['events'] / 1e6:.2f} M events",
            "clusters": f"{run['clusters']}, {run['clusters_without_inliers']} without inliers",
            "inlier tracklets per cluster": f"{run['median_inliers']:.0f} (median)",
            "states": f"{run['states']} from {run['start_s']:.3f} to {run['stop_s']:.3f} s",
        }
        rows |= _left_out_rows(run)
        rows["verdict"] = "; ".join([self.verdict.word, *self.verdict.reasons])
        if self.diagnostics:
            rows["left out or rebuilt"] = f"{len(self.diagnostics)}, listed in metrics.json"
        table = Table(show_header=False)
        for name, value in rows.items():
            table.add_row(name, value)
        return table

    def _deviations(self) -> NDArray[np.float64]:
        """Standard deviations (N, 2) of rotation, rad, and position, m, at the compared poses."""
        assert self.evaluation is not None
        t = (self.evaluation.estimate.stamps_ns - self.trajectory.start_ns) / 1e9
        t = np.clip(t, self.trajectory.start, self.trajectory.stop)
        variance = np.diagonal(self.trajectory.covariance(t)[:, :6, :6], axis1=1, axis2=2)
        return np.asarray(np.sqrt(variance.reshape(-1, 2, 3).sum(axis=2)), np.float64)

    def _write_plots(self, folder: Path, kind: str) -> None:
        # matplotlib is slow to import
        from gpvo.evaluation.report.figures import save_figure
        from gpvo.evaluation.report.plots import error_figure, path_figure, series_figure

        middle = [0.5 * (report.start + report.stop) for report in self.reports]
        counts = {
            "tracklets": [report.tracklets for report in self.reports],
            "inliers": [report.inliers for report in self.reports],
        }
        spans = [(one.start, one.stop) for one in self.verdict.stretches]
        shaded = {"dead reckoning": spans}
        figure = series_figure(middle, counts, "tracklets per cluster", shaded)
        save_figure(figure, folder / f"tracklets.{kind}")
        if self.evaluation is None:
            path = path_figure({"gpvo": self.trajectory.stamped_poses()}, None)
        else:
            path = path_figure({"gpvo": self.evaluation.estimate}, self.evaluation.ground_truth)
            stretches = shaded_stretches(self.trajectory, spans, "dead reckoning")
            figure = error_figure(
                [self.evaluation],
                stretches=stretches,
                deviations=self._deviations(),
                start_ns=self.trajectory.start_ns,
            )
            save_figure(figure, folder / f"error.{kind}")
        save_figure(path, folder / f"path.{kind}")


def _left_out_rows(run: dict[str, Any]) -> dict[str, str]:
    """Return rows of what was left out of a run, as far as anything was."""
    rows = {}
    if run["between_clusters_left_out_percent"] > 0:
        rows["between clusters"] = (
            f"{run['between_clusters_left_out_percent']:.0f} % of the events left out"
        )
    if run["thinned_percent"] > 0:
        rows["dense clusters"] = f"{run['thinned_percent']:.0f} % of the events left out"
    if run["background_left_out_percent"] + run["hot_pixels_left_out_percent"] > 0:
        rows["noise left out"] = (
            f"{run['background_left_out_percent']:.1f} % background activity"
            f" ({run['background_activity']:.2f} events per pixel and s),"
            f" {run['hot_pixels_left_out_percent']:.1f} % of hot pixels"
        )
    if run["flashes"] > 0:
        rows["flashes left out"] = f"{run['flashes']}, {run['flashes_s']:.3f} s"
    if run["at_rest_s"] > 0:
        rows["at rest"] = f"{run['at_rest_s']:.2f} s"
    return rows


def saved(folder: Path) -> str:
    """Say what of a run is saved in its folder."""
    whole, growing = folder / "trajectory.npz", folder / "trajectory.tum"
    if whole.exists():
        return f"the whole trajectory is saved in {whole}"
    if growing.exists() and (count := growing.read_bytes().count(b"\n") - 1) > 0:
        return f"{count} poses are saved in {growing}"
    return "nothing was saved"


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Raise OutputError, with what is saved, if something cannot be written."""
    try:
        yield
    except OSError as error:
        name = error.filename or folder
        raise OutputError(
            f"{name}: cannot be written ({error.strerror or error}); {saved(folder)}"
        ) from error


def save_trajectory(trajectory: Trajectory, folder: Path) -> None:
    """Write a trajectory as the result's files; each replaces an unfinished one as a whole."""
    trajectory.save(folder / "trajectory.npz")
    trajectory.export_tum(folder / "trajectory.tum")


def evaluate_trajectory(trajectory: Trajectory, ground_truth: StampedPoses) -> Evaluation:
    """Compute the paper's errors every `STEP` seconds, with the trajectory evaluated exactly there.

    Raises
    ------
    InputError
        If the two have no time in common.
    """
    return evaluate(ContinuousPoses.of(trajectory), ground_truth, step=STEP)
