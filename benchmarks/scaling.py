"""How the cost grows with the rate of events, the resolution and the number of features.

python -m benchmarks.scaling [--resolutions 240x180 346x260 640x480 1280x720] [--seconds S]
    [--output DIR]

Each recording is a hand-held camera in a simulated room. What is compiled is compiled before.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from rich.console import Console

from benchmarks.dataset import exit_with
from benchmarks.options import positive, size
from gpvo.config import Configuration
from gpvo.evaluation.report.machine import machine, machine_text
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.evaluation.report.run_time import peak_memory_bytes
from gpvo.evaluation.report.table import Cell, ResultTable, print_table, to_markdown
from gpvo.odometry import Odometry
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate

THRESHOLDS = (0.5, 0.25, 0.15)
"""Contrasts that make an event: fewer and more events of the same scene and motion."""
FEATURES = (50, 100, 200, 400)
WIDTH, FOCAL_LENGTH = 346, 226.0
"""The field of view is that of this sensor, pixels."""
STAGES = ("events and clustering", "tracking", "tracklets", "outlier rejection", "estimation")


@dataclass(frozen=True)
class Point:
    """Cost of one run.

    Attributes
    ----------
    recording, features
        What was run, with how many features at most.
    seconds, events, clusters
        What there was to do: duration, events of both cameras, clusters.
    wall, cpu
        Seconds that it took.
    stages
        (clusters, 5) elapsed seconds of every stage and cluster.
    memory
        Largest resident memory so far, bytes.
    """

    recording: str
    features: int
    seconds: float
    events: int
    clusters: int
    wall: float
    cpu: float
    stages: np.ndarray
    memory: int

    @property
    def rate(self) -> float:
        """Events of both cameras per second."""
        return self.events / self.seconds

    def row(self) -> tuple[Cell, ...]:
        """Return a row of the table."""
        each = 1e3 * self.stages.mean(axis=0)
        texts = [
            self.recording,
            f"{self.rate / 1e6:.2f}",
            f"{self.features}",
            f"{self.clusters / self.seconds:.0f}",
            f"{1e6 * self.stages[:, 0].sum() / self.events * 1e3:.0f}",
            *(f"{spent:.1f}" for spent in each[1:]),
            f"{self.cpu / self.seconds:.2f}",
            f"{self.seconds / self.wall:.2f}",
            f"{self.memory / 2**20:.0f}",
        ]
        return tuple(map(Cell, texts))


HEADINGS = (
    *("recording", "M events/s", "features", "clusters/s", "events: ns each"),
    *("tracking: ms", "tracklets: ms", "MC-RANSAC: ms", "estimation: ms"),
    *("CPU s per s", "x real time", "memory MiB"),
)


@dataclass
class StageClock:
    """Elapsed seconds of the stages, in order of their ends."""

    spent: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in STAGES})

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what is done within."""
        start = perf_counter()
        yield
        self.spent[name].append(perf_counter() - start)

    def by_cluster(self, clusters: int) -> np.ndarray:
        """Return (clusters, 5) seconds."""
        return np.array([self.spent[name][:clusters] for name in STAGES]).T


def measure(recording: SimulatedRecording, name: str, features: int) -> Point:
    """Run the odometry with so many features at most, whatever the time between clusters."""
    configuration = Configuration.model_validate(
        {"tracking": {"klt": {"max_features": features, "usual_features": features}}}
    )
    clock = StageClock()
    odometry = Odometry(recording.rig, configuration, clock.stage)
    wall, cpu = perf_counter(), process_time()
    odometry.run(recording)
    wall, cpu = perf_counter() - wall, process_time() - cpu
    reports = odometry.reports
    return Point(
        name,
        features,
        reports[-1].stop - reports[0].start,
        sum(report.events for report in reports),
        len(reports),
        wall,
        cpu,
        clock.by_cluster(len(reports)),
        peak_memory_bytes(),
    )


def room(
    resolution: tuple[int, int], seconds: float, threshold: float = 0.25
) -> SimulatedRecording:
    """Simulate a hand-held camera with the same field of view at any resolution."""
    return simulate(
        SimulationConfig(
            seed=3,
            resolution=resolution,
            focal_length=FOCAL_LENGTH * resolution[0] / WIDTH,
            duration=seconds,
            threshold=threshold,
            pixels_per_frame=0.5 if resolution[0] <= 640 else 1.0,
        )
    )


def slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the slope of a straight line through log y over log x."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def growth(stages: np.ndarray) -> float:
    """Return the median cost of a cluster in the last quarter over that in the second one."""
    total = stages.sum(axis=1)
    quarter = len(total) // 4
    return float(np.median(total[-quarter:]) / np.median(total[quarter : 2 * quarter]))


def sizes(resolutions: Sequence[tuple[int, int]], seconds: float) -> list[Point]:
    """Run every resolution with the usual number of features."""
    features = Configuration().tracking.klt.usual_features
    rooms = ((f"{w}x{h}", room((w, h), seconds)) for w, h in resolutions)
    return [measure(recording, name, features) for name, recording in rooms]


def rates(resolution: tuple[int, int], seconds: float) -> list[Point]:
    """Run one resolution at several rates of events."""
    features = Configuration().tracking.klt.usual_features
    name = "{}x{}".format(*resolution)
    rooms = [(f"{name}, threshold {c:g}", room(resolution, seconds, c)) for c in THRESHOLDS]
    return [measure(recording, name, features) for name, recording in rooms]


def features(resolution: tuple[int, int], seconds: float) -> list[Point]:
    """Run one recording with several numbers of features."""
    recording, name = room(resolution, seconds), "{}x{}".format(*resolution)
    return [measure(recording, name, count) for count in FEATURES]


def findings(by_rate: Sequence[Point], by_features: Sequence[Point]) -> list[str]:
    """Say how the cost grows."""
    per_second = [point.stages.sum() / point.seconds for point in by_rate]
    per_event = [point.stages[:, 0].sum() / point.seconds for point in by_rate]
    per_cluster = [point.stages[:, 1:].sum() / point.clusters for point in by_features]
    event_rates = [point.rate for point in by_rate]
    longest = max((*by_rate, *by_features), key=lambda point: point.clusters)
    return [
        f"slope of the whole cost over the rate of events: {slope(event_rates, per_second):.2f}",
        f"slope of the events' own stage: {slope(event_rates, per_event):.2f}",
        f"slope of a cluster's cost over the features: {slope(FEATURES, per_cluster):.2f}",
        f"last quarter of a run over the second one: {growth(longest.stages):.2f}",
    ]


def main(arguments: Sequence[str] | None = None, console: Console | None = None) -> None:
    """Measure, print the table and the slopes, and write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    default = [(240, 180), (346, 260), (640, 480), (1280, 720)]
    parser.add_argument("--resolutions", nargs="+", type=size, default=default)
    parser.add_argument("--seconds", type=positive, default=2.0, help="of every recording")
    parser.add_argument("--output", type=Path, help="folder for scaling.md")
    options, console = parser.parse_args(arguments), console or Console()
    resolutions = options.resolutions
    Odometry(room((120, 90), 0.4).rig).run(room((120, 90), 0.4))  # compiles
    by_size = sizes(resolutions, options.seconds)
    by_rate = rates(resolutions[0], options.seconds)
    by_features = features(resolutions[0], options.seconds)
    rows = tuple(point.row() for point in (*by_size, *by_rate, *by_features))
    table = ResultTable(
        "Cost by resolution, rate of events and features", HEADINGS, rows, len(rows)
    )
    lines = [*findings(by_rate, by_features), machine_text(machine())]
    print_table(console, table)
    console.print("\n".join(lines), highlight=False)
    if options.output is not None:
        text = to_markdown(table) + "\n" + "\n".join(f"- {line}" for line in lines) + "\n"
        (make_folder(options.output) / "scaling.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    exit_with(main)
