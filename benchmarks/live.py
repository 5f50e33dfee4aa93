"""Latency of the live odometry, and what it sheds when the source is too fast.

python -m benchmarks.live [--speeds 1,2,4,10] [--seconds 5] [--resolution 346x260]

A latency is the time from the arrival of a cluster's last events to the estimate that contains
them. A speed of 2 gives a recording twice as fast as it was recorded. What the computer can do at
this moment is said first.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.options import positive, positives, size
from gpvo import Configuration, LiveOdometry, Odometry, Trajectory
from gpvo.live.load import Level
from gpvo.live.session import LiveSession
from gpvo.live.sources import RecordingPlayer
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.warm_up.whole import warm_up


@dataclass(frozen=True)
class LiveRun:
    """What became of a recording that was played `speed` times as fast as recorded.

    Attributes
    ----------
    latency
        (3,) median, 95 % and 99 %, seconds.
    shed
        Share of the events that were left out, from 0 to 1.
    worst
        The most that was shed of each kind; see `gpvo.live.load`.
    error
        Largest distance of the path from that of a run without a clock, metres.
    """

    speed: float
    latency: tuple[float, float, float]
    shed: float
    worst: Level
    error: float

    def row(self) -> str:
        """Return a row of the table."""
        median, most, nearly_all = (1e3 * each for each in self.latency)
        return (
            f"{self.speed:6g} {median:8.0f} {most:8.0f} {nearly_all:8.0f} {100 * self.shed:7.1f}"
            f" {self.worst.spacing:7.2f} {100 * self.worst.features:9.0f}"
            f" {1e3 * self.error:9.1f}"
        )


HEADER = " speed    50% ms   95% ms   99% ms  shed % spacing features %  error mm"


def live_run(recording: SimulatedRecording, speed: float, reference: Trajectory) -> LiveRun:
    """Play a recording, and compare the path with that of `Odometry.run`."""
    live = LiveOdometry(recording.rig)
    session = LiveSession(live, recording.rig, RecordingPlayer(recording, speed))
    session.run()
    trajectory = live.close()
    events = len(recording.left) + len(recording.right)
    return LiveRun(
        speed,
        tuple(session.latency.percentiles().tolist()),
        (session.load.left_out + session.load.discarded) / events,
        session.load.worst,
        np.nan if trajectory is None else largest_distance(trajectory, reference),
    )


def largest_distance(trajectory: Trajectory, reference: Trajectory) -> float:
    """Return the largest distance of two paths at the same times, metres."""
    start, stop = max(trajectory.start, reference.start), min(trajectory.stop, reference.stop)
    t = np.linspace(start, stop, 200)
    apart = trajectory.pose(t)[:, :3, 3] - reference.pose(t)[:, :3, 3]
    return float(np.linalg.norm(apart, axis=1).max())


def main() -> None:
    """Print a table with a row for each speed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--speeds", type=positives, default=[1.0, 2.0, 4.0, 10.0])
    parser.add_argument("--seconds", type=positive, default=5.0)
    parser.add_argument("--resolution", type=size, default=(346, 260))
    given = parser.parse_args()
    config = SimulationConfig(
        seed=3,
        duration=given.seconds,
        resolution=given.resolution,
        focal_length=226.0 * given.resolution[0] / 346,
        noise_rate=1.0,
    )
    recording = simulate(config)
    warm_up(Configuration())
    began = time.perf_counter()
    reference = Odometry(recording.rig).run(recording)
    factor = recording.duration / (time.perf_counter() - began)
    print(f"without a clock: {factor:.2f} x real time")
    print(HEADER)
    for speed in given.speeds:
        print(live_run(recording, speed, reference).row(), flush=True)


if __name__ == "__main__":
    main()
