"""Front ends compared on recordings with known motion: trackers, event images, filters, times.

Run as `python -m benchmarks.front_end`; `--recording FILE --calibration FILE --ground-truth FILE`
adds a recording of yours to the simulated ones. Columns are those of `gpvo inspect`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
from rich.console import Console
from rich.table import Table

from gpvo.config import Configuration
from gpvo.evaluation.loading import load_poses
from gpvo.inspection import inspect
from gpvo.inspection_summary import summarize
from gpvo.inspection_truth import Truth, truth_of_poses, truth_of_simulation
from gpvo.recordings import Recording, open_recording
from gpvo.simulation.recording import SimulationConfig, simulate

FRONT_ENDS: dict[str, dict[str, Any]] = {
    "default": {},
    "viso2": {"tracking": {"tracker": "viso2", "features": {"response_threshold": 1500}}},
    "time surface": {"tracking": {"image": "time_surface"}},
    "background filter 20 ms": {"clustering": {"background_filter": 0.02}},
    "background filter 5 ms": {"clustering": {"background_filter": 0.005}},
    "hot pixels masked": {"clustering": {"hot_pixel_ratio": 10}},
    "10 000 events": {"clustering": {"max_events": 10_000}},
    "40 000 events": {"clustering": {"max_events": 40_000}},
    "nearest event's time": {"tracklets": {"time_radius": 0}},
    "half resolution too": {"tracking": {"resolutions": [1, 2]}},
    "smoothing 1.5 px": {"tracking": {"klt": {"smoothing": 1.5}}},
    "patch 21 px": {"tracking": {"klt": {"patch_size": 21}}},
    "patch 41 px": {"tracking": {"klt": {"patch_size": 41}}},
}
SIMULATIONS = {
    "fast": SimulationConfig(seed=11, motion="fast", duration=1.5, noise_rate=0.5),
    "noisy": SimulationConfig(
        seed=12,
        motion="hand_held",
        duration=1.5,
        noise_rate=3.0,
        threshold=0.3,
        threshold_sigma=0.06,
        boxes=8,
    ),
}


def recordings(options: argparse.Namespace) -> Iterator[tuple[str, Recording, Truth]]:
    """Names, recordings and their truth."""
    if options.recording is not None:
        opened = open_recording(options.recording, options.calibration)
        poses = load_poses(options.ground_truth, opened.rig)
        yield options.recording.stem, opened, truth_of_poses(poses, opened.start_ns)
    for name, config in SIMULATIONS.items():
        recording = simulate(config)
        yield name, recording, truth_of_simulation(recording)


def compare(name: str, recording: Recording, truth: Truth, options: argparse.Namespace) -> Table:
    """All front ends on a part of one recording."""
    table = Table(
        "front end",
        "inliers",
        "precision",
        "recall",
        "rms px",
        "disparity",
        "slope",
        "ω",
        "v",
        "s/s",
    )
    table.title = name
    seconds = min(options.duration, recording.duration)
    start = min(options.start, recording.duration - seconds)
    for label in options.front_ends:
        configuration = Configuration.model_validate(FRONT_ENDS[label])
        began = time.process_time()
        summary = summarize(inspect(recording, truth, configuration, start, seconds))
        spent = time.process_time() - began
        ransac, errors = summary["MC-RANSAC"], summary["inlier errors"]
        table.add_row(
            label,
            f"{ransac['true_inliers_median']:.0f}",
            f"{ransac['precision']:.4f}",
            f"{ransac['recall']:.3f}",
            f"{errors['left_rms_px']:.3f}",
            f"{errors['disparity_rms_px']:.3f}",
            f"{summary['flow']['slope']:.4f}",
            f"{ransac['iterative_angular_rms_rad_s']:.3f}",
            f"{ransac['iterative_linear_rms_m_s']:.3f}",
            f"{spent / seconds:.2f}",
        )
    return table


def main() -> None:
    """Print a table for every recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recording", type=Path)
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--ground-truth", type=Path)
    parser.add_argument("--start", type=float, default=2.0, help="seconds to skip")
    parser.add_argument("--duration", type=float, default=1.5, help="seconds of each")
    parser.add_argument(
        "--front-ends", nargs="+", choices=FRONT_ENDS, default=list(FRONT_ENDS), metavar="NAME"
    )
    options = parser.parse_args()
    if options.recording is not None and options.ground_truth is None:
        parser.error("--recording needs --ground-truth")
    cv2.setNumThreads(1)
    console = Console()
    for name, recording, truth in recordings(options):
        console.print(compare(name, recording, truth, options))


if __name__ == "__main__":
    main()
