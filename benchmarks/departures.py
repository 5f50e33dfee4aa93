"""What each departure from the paper buys: the defaults, and the defaults but for one of them.

Run as `python -m benchmarks.departures`; `--recording FILE --calibration FILE --ground-truth FILE`
takes a recording of yours, `--start` and `--duration` a part of it. Errors are the paper's, every
0.01 s: final one in percent of the path, root mean square of the relative one.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.front_end import trajectory_errors
from benchmarks.known_motion import known_recordings, parse_options
from gpvo.config import PRESETS, Configuration
from gpvo.simulation import SimulationConfig

DEPARTURES: dict[str, tuple[str, ...]] = {
    "clusters of 20 000 events": ("clustering.max_events",),
    "noise and flashes kept": (
        "clustering.background_filter",
        "clustering.hot_pixel_ratio",
        "clustering.skip_flashes",
    ),
    "half resolution as well": ("tracking.resolutions",),
    "binary frames, nearest event's time": ("tracking.image", "tracklets.time_radius"),
    "LIBVISO2's descriptors": ("tracking.tracker",),
    "a new anchor in each frame": ("tracking.klt",),
    "contours where they are seen": ("tracking.compensation",),
    "landmarks at rest left out": ("tracklets.rest_duration",),
    "tracklets of 40 ms": ("tracklets.min_duration",),
    "fixed noise": (
        "noise.measurement_information",
        "noise.track_drift",
        "noise.motion_memory",
        "noise.measurement_memory",
    ),
    "no acceleration ahead": ("noise.acceleration_memory",),
    "no threshold in pixels": ("mc_ransac.pixel_threshold", "mc_ransac.disparity_tolerance"),
    "all samples drawn, refined once": ("mc_ransac.confidence", "mc_ransac.refinements"),
    "least squares": ("estimator.loss", "estimator.loss_scale"),
    "window without memory": ("estimator.method",),
    "velocity kept for ever": ("estimator.bridge",),
    "an update at every cluster": ("estimator.interval",),
}
"""What is done as in the paper, and the fields that do it; others that differ go by their name."""

SIMULATIONS = {"simulated": SimulationConfig(seed=12, noise_rate=0.5)}


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
    """Return the fields, as stage.name, in which the paper's preset differs from the defaults."""
    defaults, paper = Configuration(), Configuration(preset="paper")
    return [
        f"{stage}.{name}"
        for stage, values in PRESETS["paper"].items()
        for name in values
        if getattr(getattr(defaults, stage), name) != getattr(getattr(paper, stage), name)
    ]


def paper_values(fields: Sequence[str]) -> dict[str, Any]:
    """Return the paper's values of fields of stages."""
    values: dict[str, dict[str, Any]] = {}
    for stage, _, field in (name.partition(".") for name in fields):
        values.setdefault(stage, {})[field] = PRESETS["paper"][stage][field]
    return values


def error_table(name: str, errors: Mapping[str, tuple[float, float]]) -> Table:
    """Return a table of relative and final errors on one recording."""
    table = Table("as in the paper", "final %", "relative 1e-3", title=name)
    for variant, (relative, final) in errors.items():
        table.add_row(variant, f"{100 * final:.2f}", f"{1e3 * relative:.2f}")
    return table


def main() -> None:
    """Print a table for every recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for known in known_recordings(parse_options(parser), SIMULATIONS):
        errors = {name: trajectory_errors(known, each) for name, each in variants().items()}
        Console().print(error_table(known.name, errors))


if __name__ == "__main__":
    main()
