"""Compare front ends on recordings with known motion: every default with its alternatives.

Run as `python -m benchmarks.front_end`; `--recording FILE --calibration FILE --ground-truth FILE`
adds a recording of yours to the simulated ones. It prints a table for every recording, then one of
each front end relative to the default over all recordings.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.known_motion import KnownRecording, known_recordings, parse_options
from gpvo import Odometry
from gpvo.commands.result import evaluate_trajectory
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.front_end.inspect import inspect
from gpvo.evaluation.front_end.summary import summarize
from gpvo.simulation import SimulationConfig

DEFAULT = "default"
Fields = Mapping[str, Any]
FRONT_ENDS: dict[str, dict[str, Fields]] = {
    "": {DEFAULT: {}},
    "tracker": {
        "viso2": {"tracking": {"tracker": "viso2", "features": {"response_threshold": 700}}},
    },
    "event image": {
        "binary": {"tracking": {"image": "binary"}},
        "time surface": {"tracking": {"image": "time_surface"}},
    },
    "time": {
        "events within 8 px": {"tracking": {"compensation": {"time_radius": 8}}},
        "binary, nearest event": {
            "tracking": {"image": "binary"},
            "tracklets": {"time_radius": 0},
        },
    },
    "cluster": {
        "10 000 events": {"clustering": {"max_events": 10_000}},
        "20 000 events": {"clustering": {"max_events": 20_000}},
        "motion 1.5 px": {"clustering": {"motion": 1.5}},
        "motion 3 px": {"clustering": {"motion": 3}},
    },
    "filter": {
        "background, none": {"clustering": {"background_filter": 0}},
        "background, 20 ms": {"clustering": {"background_filter": 0.02}},
        "background, 5 ms": {"clustering": {"background_filter": 0.005}},
        "hot pixels, all": {"clustering": {"hot_pixel_ratio": 0}},
    },
    "patch": {
        "21 px": {"tracking": {"klt": {"patch_size": 21}}},
        "31 px": {"tracking": {"klt": {"patch_size": 31}}},
        "41 px": {"tracking": {"klt": {"patch_size": 41}}},
        "blur 0.5 px": {"tracking": {"klt": {"smoothing": 0.5}}},
        "blur 1 px": {"tracking": {"klt": {"smoothing": 1.0}}},
    },
    "features": {
        "120": {"tracking": {"klt": {"max_features": 120}}},
        "300": {"tracking": {"klt": {"usual_features": 300, "spacing": 6}}},
        "half resolution too": {"tracking": {"resolutions": [1, 2]}},
    },
}
BY_NAME = {name: fields for group in FRONT_ENDS.values() for name, fields in group.items()}
SIMULATIONS = {
    "simulated, turning fast": SimulationConfig(seed=11, motion="rotation", noise_rate=0.5),
    "simulated, to and fro": SimulationConfig(
        seed=12, motion="back_and_forth", noise_rate=0.5, boxes=3
    ),
    "simulated, noisy": SimulationConfig(
        seed=13,
        motion="hand_held",
        noise_rate=3.0,
        threshold=0.3,
        threshold_sigma=0.06,
        boxes=8,
    ),
}


@dataclass(frozen=True)
class Quality:
    """Quality of a front end on one recording, with the numbers of `gpvo inspect`."""

    true_inliers: float  # in the median cluster
    precision: float  # of MC-RANSAC
    recall: float
    left: float  # RMS error of inliers, pixels
    disparity: float
    slope: float  # of measured on true image motion
    angular: float  # RMS error of MC-RANSAC's velocity, rad/s
    linear: float  # m/s
    relative: float  # RMS error of the trajectory over 10 ms
    final: float  # share of the path
    cost: float  # CPU seconds of the front end per second


HEADINGS = ("inliers", "precision", "recall", "px", "d px", "slope", "ω", "v", "rel.", "final")
FORMATS = ("{:.0f}", "{:.4f}", "{:.3f}", "{:.2f}", "{:.2f}", "{:.4f}", "{:.3f}", "{:.3f}")
RELATIVE_FORMATS = ("{:.2e}", "{:.2%}", "{:.2f}")


def quality(known: KnownRecording, configuration: Configuration) -> Quality:
    """Inspect a front end and measure the errors of the default estimator with it."""
    part = (known.start, known.duration)
    began = time.process_time()
    summary = summarize(inspect(known.recording, known.truth, configuration, *part))
    cost = (time.process_time() - began) / known.duration
    ransac, errors = summary["MC-RANSAC"], summary["inlier errors"]
    return Quality(
        ransac["true_inliers_median"],
        ransac["precision"],
        ransac["recall"],
        errors["left_rms_px"],
        errors["disparity_rms_px"],
        summary["flow"]["slope"],
        ransac["iterative_angular_rms_rad_s"],
        ransac["iterative_linear_rms_m_s"],
        *trajectory_errors(known, configuration),
        cost,
    )


def trajectory_errors(known: KnownRecording, configuration: Configuration) -> tuple[float, float]:
    """Compute RMS relative error and final error per path length; NaN if tracking failed."""
    try:
        odometry = Odometry(known.recording.rig, configuration)
        trajectory = odometry.run(known.recording, known.start, known.duration)
    except InputError:
        return np.nan, np.nan
    evaluation = evaluate_trajectory(trajectory, known.ground_truth)
    relative = evaluation.relative_error.norms["se3"]
    path = evaluation.distances[-1]
    final = evaluation.global_error.norms["translation"][-1]
    return float(np.sqrt(np.mean(relative**2))), final / path if path > 0 else np.nan


def configuration_of(name: str) -> Configuration:
    """Return the configuration of a front end, with states at intervals for a cheap benchmark."""
    return Configuration.model_validate({**BY_NAME[name], "estimator": {"state_interval": 0.025}})


def recording_table(name: str, results: Mapping[str, Quality]) -> Table:
    """Return a table of the front ends on one recording."""
    table = Table("", "front end", *HEADINGS, "s/s", title=name)
    formats = FORMATS + RELATIVE_FORMATS
    for group, label in _rows(results):
        values = astuple(results[label])
        cells = [
            form.format(value) if np.isfinite(value) else ""
            for form, value in zip(formats, values, strict=True)
        ]
        table.add_row(group, label, *cells, end_section=_is_last(label, results))
    return table


def summary_table(results: Sequence[Mapping[str, Quality]]) -> Table:
    """Return a table of ratios to the default: geometric means over the recordings."""
    title = f"times the default's, over {len(results)} recordings"
    table = Table("", "front end", "inliers", "px", "ω, v", "rel.", "final", "s/s", title=title)
    for group, label in _rows(results[0]):
        of = {field.name: _ratio(field.name, label, results) for field in fields(Quality)}
        velocity = np.sqrt(of["angular"] * of["linear"])
        shown = (of["true_inliers"], of["left"], velocity, of["relative"], of["final"], of["cost"])
        cells = [f"{value:.2f}" for value in shown]
        table.add_row(group, label, *cells, end_section=_is_last(label, results[0]))
    return table


def _ratio(field: str, label: str, results: Sequence[Mapping[str, Quality]]) -> float:
    """Compute the geometric mean of a front end's number over the default's, where known."""
    numbers = np.array([[getattr(r[name], field) for name in (label, DEFAULT)] for r in results])
    known = (np.isfinite(numbers) & (numbers > 0)).all(axis=1)
    if not known.any():
        return np.nan
    return float(np.exp(np.mean(np.log(numbers[known, 0] / numbers[known, 1]))))


def _rows(results: Mapping[str, Quality]) -> list[tuple[str, str]]:
    """Return group (for its first member) and name of the front ends that have results."""
    rows = []
    for group, members in FRONT_ENDS.items():
        present = [name for name in members if name in results]
        rows += [(group if index == 0 else "", name) for index, name in enumerate(present)]
    return rows


def _is_last(label: str, results: Mapping[str, Quality]) -> bool:
    """Return whether a front end is the last of its group."""
    members = next(group for group in FRONT_ENDS.values() if label in group)
    return [name for name in members if name in results][-1] == label


def main() -> None:
    """Print a table for every recording, and one over all recordings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--front-ends", nargs="+", choices=BY_NAME, default=list(BY_NAME), metavar="NAME"
    )
    options = parse_options(parser)
    cv2.setNumThreads(1)
    console, results = Console(), []
    names = [DEFAULT, *(name for name in options.front_ends if name != DEFAULT)]
    for known in known_recordings(options, SIMULATIONS):
        quality(known, configuration_of(DEFAULT))  # compiles, so that no cost includes it
        results.append({name: quality(known, configuration_of(name)) for name in names})
        console.print(recording_table(known.name, results[-1]))
    console.print(summary_table(results))


if __name__ == "__main__":
    main()
