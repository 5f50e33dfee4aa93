"""What each departure from the paper buys: errors with one undone, over those of the defaults.

python -m benchmarks.departures [--seeds N] [--first-seed N] [--duration SECONDS] [--jobs N]

Errors of one recording scatter, so that a table has the geometric mean over many: of the position,
and of steps of 0.01 s. Undone means as in the paper.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.dataset import exit_with
from benchmarks.options import at_least_one, positive, zero_or_more
from gpvo.commands.result import evaluate_trajectory
from gpvo.commands.workers import in_order
from gpvo.config import PRESETS, Configuration
from gpvo.errors import InputError
from gpvo.evaluation.report.table import Cell, ResultTable, print_table
from gpvo.odometry import Odometry
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate

RECORDINGS = {
    "hand-held": SimulationConfig(noise_rate=0.5),
    "back and forth": SimulationConfig(motion="back_and_forth", noise_rate=0.5),
    "fast": SimulationConfig(motion="fast", noise_rate=0.5),
    "noisy": SimulationConfig(threshold=0.35, noise_rate=3.0),
    "driving": SimulationConfig(motion="driving", baseline=0.3, noise_rate=0.5),
}
"""Motions and sensors, each with a room, a motion and a sensor of its own for each seed."""

DEPARTURES: dict[str, tuple[str, ...]] = {
    "clusters of 0.1 s or 20 000 events": ("clustering.window", "clustering.max_events"),
    "noise and flashes kept": (
        "clustering.background_filter",
        "clustering.hot_pixel_ratio",
        "clustering.skip_flashes",
    ),
    "nothing left out between clusters": ("clustering.spacing",),
    "half resolution as well": ("tracking.resolutions",),
    "binary frames, nearest event's time": ("tracking.image", "tracklets.time_radius"),
    "LIBVISO2's descriptors": ("tracking.tracker",),
    "a new anchor in each frame": ("tracking.klt.anchor_correlation",),
    "surfaces that face the camera": ("tracking.klt.slopes",),
    "the strongest features": ("tracking.klt.candidates",),
    "no landmark known again": ("tracking.klt.lost_landmarks", "estimator.lost_landmarks"),
    "equal deviations": ("tracking.klt.deviations",),
    "contours where they are seen": ("tracking.compensation.lag_share",),
    "pictures of their own events": ("tracking.compensation.little_motion",),
    "moved as before where lost": ("tracking.compensation.sharpest",),
    "all events of dense clusters": ("tracking.compensation.density",),
    "disparities from 2 pixels on": ("tracklets.min_disparity",),
    "image motion of 2 pixels": ("tracklets.min_length",),
    "tracklets of 40 ms": ("tracklets.min_duration",),
    "no threshold in pixels": ("mc_ransac.pixel_threshold", "mc_ransac.disparity_tolerance"),
    "all samples drawn, refined once": ("mc_ransac.confidence", "mc_ransac.refinements"),
    "nothing moves by itself": ("mc_ransac.track_record", "tracking.klt.crowding"),
    "window without memory": ("estimator.method",),
    "fixed noise": (
        "noise.measurement_information",
        "noise.track_drift",
        "noise.motion_memory",
        "noise.measurement_memory",
    ),
    "least squares": ("estimator.loss", "estimator.loss_scale"),
    "begins with the first measurement": ("estimator.start_landmarks",),
    "no acceleration ahead": ("noise.acceleration_memory",),
    "final states stay": ("estimator.settling",),
    "velocity kept for ever": ("estimator.bridge",),
    "an update at every cluster": ("estimator.interval",),
}
"""What is done as in the paper, and the fields that do it; others that differ go by their name."""

Errors = tuple[float, float]
"""RMS of the position, metres, and of the SE(3) error of steps of 0.01 s; NaN if a run failed."""


def variants() -> dict[str, Configuration]:
    """Return the defaults, the defaults with each departure undone, and the paper's way."""
    named = {field for fields in DEPARTURES.values() for field in fields}
    others = {field: (field,) for field in differing() if field not in named}
    undone = {
        name: Configuration(**paper_values(fields))
        for name, fields in (DEPARTURES | others).items()
    }
    return {"defaults": Configuration(), **undone, "preset: paper": Configuration(preset="paper")}


def differing() -> list[str]:
    """Return the fields, such as estimator.method, in which the paper's preset differs."""
    defaults, paper = (
        dict(leaves(Configuration(preset=preset).model_dump())) for preset in ("auto", "paper")
    )
    return [name for name, _ in leaves(PRESETS["paper"]) if defaults[name] != paper[name]]


def leaves(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and values of fields of stages, and of those in them."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield above + name, value


def paper_values(fields: Sequence[str]) -> dict[str, Any]:
    """Return the paper's values of fields."""
    paper = dict(leaves(PRESETS["paper"]))
    values: dict[str, Any] = {}
    for field in fields:
        *stages, name = field.split(".")
        inner = values
        for stage in stages:
            inner = inner.setdefault(stage, {})
        inner[name] = paper[field]
    return values


def errors(config: SimulationConfig) -> dict[str, Errors]:
    """Simulate a recording and measure the errors of each variant."""
    recording = simulate(config)
    return {name: run_errors(recording, each) for name, each in variants().items()}


def run_errors(recording: SimulatedRecording, configuration: Configuration) -> Errors:
    """Measure the errors of one variant."""
    try:
        trajectory = Odometry(recording.rig, configuration).run(recording)
        found = evaluate_trajectory(trajectory, recording.ground_truth)
    except InputError:
        return np.nan, np.nan
    norms = found.global_error.norms["translation"], found.relative_error.norms["se3"]
    position, step = (float(np.sqrt(np.mean(norm**2))) for norm in norms)
    return position, step


def summary(runs: Sequence[Mapping[str, Errors]]) -> ResultTable:
    """Return a table of errors over the defaults': geometric mean, with its standard deviation."""
    table = {name: np.array([run[name] for run in runs]) for name in runs[0]}
    default = table.pop("defaults")
    rows = [
        (Cell(name), *(Cell(_ratio(one)) for one in (found / default).T), _failed(found))
        for name, found in table.items()
    ]
    title = f"errors over those of the defaults, {len(runs)} recordings"
    return ResultTable(title, ("as in the paper", "position", "step", "failed"), tuple(rows))


def _ratio(ratios: NDArray[np.float64]) -> str:
    logs = np.log(ratios[np.isfinite(ratios)])
    if len(logs) < 2:
        return ""
    mean = float(np.exp(logs.mean()))
    return f"{mean:.2f} ± {mean * logs.std(ddof=1) / np.sqrt(len(logs)):.2f}"


def _failed(found: NDArray[np.float64]) -> Cell:
    count = int(np.isnan(found[:, 0]).sum())
    return Cell(str(count) if count else "")


def arguments() -> argparse.ArgumentParser:
    """Return a parser of the options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=at_least_one, default=3, help="of each kind of recording")
    parser.add_argument("--first-seed", type=zero_or_more, default=0, help="others follow it")
    parser.add_argument("--duration", type=positive, default=2.0, help="seconds of each recording")
    parser.add_argument(
        "--jobs", type=at_least_one, default=os.cpu_count(), help="recordings at once"
    )
    return parser


def main() -> None:
    """Measure all variants on all recordings, and print the table."""
    options = arguments().parse_args()
    tasks = [
        (each.model_copy(update={"seed": options.first_seed + i, "duration": options.duration}),)
        for i in range(options.seeds)
        for each in RECORDINGS.values()
    ]
    print_table(Console(), summary(list(in_order(errors, tasks, options.jobs, None))))


if __name__ == "__main__":
    exit_with(main)
