"""Is the odometry as good as it says? NEES of whole runs, from events to the trajectory.

python -m benchmarks.honest_runs [--motions NAME ...] [--seeds N] [--first-seed N]
    [--duration SECONDS] [--jobs N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.stats import chi2

from benchmarks.dataset import exit_with
from benchmarks.options import at_least_one, positive, zero_or_more
from gpvo.commands.workers import in_order
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.metrics.nees import mean_nees_interval, nees
from gpvo.evaluation.report.table import Cell, ResultTable, print_table
from gpvo.odometry import Odometry
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.simulation.motion import Motion, MotionName
from gpvo.trajectory import StampedPoses, States

Array = NDArray[np.float64]

SMALL = SimulationConfig(resolution=(240, 180), focal_length=157.0)
"""The simulator's default field of view on a smaller sensor: many runs in little time."""

MOTIONS = {
    "slow": SMALL,
    "hand-held": SMALL,
    "fast": SMALL.model_copy(update={"motion": "fast"}),
    "noisy": SMALL.model_copy(update={"noise_rate": 5.0}),
}
"""Motions and sensors; room, motion and sensor differ for each seed. Slow is hand-held, slowed."""

SLOWED = 3.0
"""How many times longer slow motion takes than the same way hand-held."""

PHASES = 1.2
"""Seconds of a motion in which runs begin: the longest time from one of its waypoints to the next.

Motions turn at the same times for all seeds. NEES at an end depends on how long ago that was.
"""

SHARES = (0.5, 0.75, 1.0)
"""Where in a run it is measured, shares of its duration."""


@dataclass(frozen=True)
class HonestRun:
    """NEES of one run at SHARES of it, per degree of freedom: 1 on average if consistent.

    Attributes
    ----------
    motion, seed
        What was simulated.
    pose, velocity
        NEES of the pose relative to the first one and of the body twist; empty if the run failed.
    failure
        Reason why there is no trajectory; empty if there is one.
    """

    motion: str
    seed: int
    pose: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    failure: str = ""


def run(motion: str, seed: int, duration: float, configuration: Configuration) -> HonestRun:
    """Simulate a recording of a motion, estimate it, and compare errors with covariances."""
    recording = recorded(motion, seed, duration)
    configuration = configuration.model_copy(update={"seed": seed})
    try:
        trajectory = Odometry(recording.rig, configuration).run(recording)
    except InputError as error:
        return HonestRun(motion, seed, failure=str(error))
    length = trajectory.stop - trajectory.start
    t = trajectory.start + np.array([0.0, *SHARES]) * length
    t = np.minimum(t, trajectory.stop)  # which the sum may exceed by its rounding
    truth = States(t, recording.motion.pose(t), recording.motion.twist(t))
    pose, velocity = (tuple((one / 6).tolist()) for one in nees(trajectory, truth, t[1:]))
    return HonestRun(motion, seed, pose, velocity)


def recorded(motion: str, seed: int, duration: float) -> SimulatedRecording:
    """Simulate the recording of one seed."""
    config = MOTIONS[motion].model_copy(update={"seed": seed, "duration": duration})
    slowed = SLOWED if motion == "slow" else 1.0
    return simulate(config, random_motion(config.motion, seed, duration, slowed))


def random_motion(name: MotionName, seed: int, duration: float, slowed: float = 1.0) -> Motion:
    """Return a random motion that takes `slowed` times longer, and begins anywhere on its way."""
    rng = np.random.default_rng(seed)
    way = Motion.random(name, duration / slowed + PHASES, rng).later(rng.uniform(0.0, PHASES))
    if slowed == 1.0:
        return way
    t = np.arange(0.0, duration / slowed + 0.5, 0.1)
    return Motion.through(StampedPoses(np.rint(1e9 * slowed * t).astype(np.int64), way.pose(t)))


def summary(runs: Sequence[HonestRun]) -> ResultTable:
    """Return a table of means and medians over the seeds, one row for each motion and time."""
    seeds = len({one.seed for one in runs})
    low, high = mean_nees_interval(seeds) / 6
    title = f"NEES / 6 of {seeds} runs: 95 % of means from {low:.2f} to {high:.2f}"
    of = [f"{name} {part}" for part in ("pose", "velocity") for name in ("mean", "median", "above")]
    rows = []
    for motion in dict.fromkeys(one.motion for one in runs):
        good = [one for one in runs if one.motion == motion and not one.failure]
        for i, share in enumerate(SHARES):
            parts = [one.pose[i] for one in good], [one.velocity[i] for one in good]
            numbers = [number for part in parts for number in _statistics(part)]
            cells = (f"{100 * share:.0f} %", str(len(good)), *(f"{x:.2f}" for x in numbers))
            rows.append((Cell(motion), *map(Cell, cells)))
    return ResultTable(title, ("", "at", "runs", *of), tuple(rows))


def _statistics(nees_per_dimension: Sequence[float]) -> tuple[float, float, float]:
    """Mean, median, and share above the quantile that 5 % of consistent ones are above."""
    values = np.array(nees_per_dimension)
    above = values > chi2.ppf(0.95, 6) / 6
    return float(values.mean()), float(np.median(values)), float(above.mean())


def arguments() -> argparse.ArgumentParser:
    """Return a parser of the options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--motions", nargs="+", choices=MOTIONS, default=list(MOTIONS), metavar="NAME"
    )
    parser.add_argument("--seeds", type=at_least_one, default=50, help="runs of each motion")
    parser.add_argument("--first-seed", type=zero_or_more, default=0, help="others follow it")
    parser.add_argument("--duration", type=positive, default=2.0, help="seconds of each run")
    parser.add_argument(
        "--jobs", type=at_least_one, default=os.cpu_count(), help="processes at once"
    )
    parser.add_argument("--output", type=Path, help="file for all runs, .json")
    return parser


def main(
    arguments_given: Sequence[str] | None = None, console: Console | None = None
) -> list[HonestRun]:
    """Parse the options, run, print and write the results."""
    options, console = arguments().parse_args(arguments_given), console or Console()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    tasks = [
        (motion, seed, options.duration, Configuration())
        for motion in options.motions
        for seed in seeds
    ]
    runs = list(in_order(run, tasks, options.jobs, None))
    print_table(console, summary(runs))
    if options.output is not None:
        text = json.dumps([asdict(one) for one in runs], indent=1)
        options.output.write_text(text + "\n", "utf-8")
    return runs


if __name__ == "__main__":
    exit_with(main)
