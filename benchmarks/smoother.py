"""What the estimators cost per cluster, and by how much their trajectories differ.

python -m benchmarks.smoother                  room1_indoor1, if it is there, and simulations
python -m benchmarks.smoother --minutes 10     and long streams: memory and constant cost
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from gpvo.estimator.gauss_newton_smoother import GaussNewtonSmoother
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from factors import StereoCamera
from factors.lie import se3_inverse, se3_log
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig, load_configuration
from gpvo.estimator import FixedLagSmoother, Repair, make_estimator
from gpvo.events import cluster_events
from gpvo.mc_ransac import VelocityFit
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.simulation.tracklets import TrackletSimulation
from gpvo.tracking import Measurements
from gpvo.trajectory import States, Trajectory

Array = NDArray[np.float64]
Update = tuple[int, float, Measurements, VelocityFit | None]

RECORDINGS = Path(__file__).parents[2] / "shared" / "recordings"
UNIQUE = EstimatorConfig(state_interval=0.0)
REAL_TIME = EstimatorConfig(method="fixed_lag", state_interval=0.1, window=6)
MODES = {
    "Gauss-Newton, unique times": UNIQUE,
    "Gauss-Newton, key times 25 ms": EstimatorConfig(state_interval=0.025),
    "GTSAM, key times 100 ms, eliminated": REAL_TIME,
    "GTSAM, key times 100 ms, variables": REAL_TIME.model_copy(update={"landmarks": "variables"}),
    "GTSAM, key times 25 ms, variables": EstimatorConfig(
        method="fixed_lag", state_interval=0.025, landmarks="variables"
    ),
    "GTSAM, unique times by QR": EstimatorConfig(method="fixed_lag", state_interval=0.0),
    "batch, key times 25 ms": EstimatorConfig(method="batch", state_interval=0.025),
    "batch, unique times": EstimatorConfig(method="batch", state_interval=0.0),
}
"""GTSAM has landmarks that are eliminated before, or as variables; at unique times these."""
STREAMED = {"gauss_newton": UNIQUE, "fixed_lag": REAL_TIME}
SMOOTHERS: dict[str, type[GaussNewtonSmoother] | type[FixedLagSmoother]] = {
    "gauss_newton": GaussNewtonSmoother,
    "fixed_lag": FixedLagSmoother,
}
WARM_UP = 10
"""Clusters that compile the kernels before the clock starts."""

console = Console()


class Recorder:
    """An estimator that only remembers what it was given, and when."""

    def __init__(self) -> None:
        self.updates: list[Update] = []
        self.began: list[float] = []
        self.repairs: list[Repair] = []

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> States:
        """Remember a cluster."""
        self.updates.append((frame, stop, measurements, fit))
        self.began.append(time.process_time())
        return States()

    def settled(self, after: float) -> States:
        """There are none."""
        return States()

    def trajectory(self, start_ns: int) -> None:
        """There is none."""


def tracklets_of(
    recording: Recording, configuration: Configuration, clusters: int
) -> tuple[StereoCamera, list[Update], float]:
    """The inlier tracklets of the first clusters, and the seconds that each took to get."""
    odometry, recorder = Odometry(recording.rig, configuration), Recorder()
    odometry.estimator = recorder
    clustering = odometry.configuration.clustering
    stream = cluster_events(recording.event_batches(), recording.rig, clustering)
    for cluster in islice(stream, clusters):
        odometry.process(cluster)
    front_end = float(np.mean(np.diff(recorder.began)[WARM_UP:]))
    return odometry.camera, recorder.updates, front_end


def timed(
    camera: StereoCamera, updates: Iterable[Update], config: EstimatorConfig
) -> tuple[Trajectory, Array]:
    """The trajectory, and the seconds of processor time that each update took.

    All is done in one thread: on a processor of its own these are seconds.
    """
    estimator = make_estimator(camera, NoiseConfig(), config)
    spent = []
    for update in updates:
        began = time.process_time()
        estimator.update(*update)
        spent.append(time.process_time() - began)
    trajectory = estimator.trajectory(0)
    assert trajectory is not None
    return trajectory, np.array(spent)


def deviation(trajectory: Trajectory, reference: Trajectory) -> Array:
    """(N, 12) difference of pose and velocity, in shares of the reference's 3 sigma.

    Every 10 ms, relative to the first common time, where both are at the origin.
    """
    start = max(trajectory.start, reference.start)
    t = np.arange(start, min(trajectory.stop, reference.stop), 0.01)[1:]
    pose = se3_log(se3_inverse(reference.pose(t)) @ trajectory.pose(t))
    difference = np.hstack([pose, trajectory.velocity(t) - reference.velocity(t)])
    sigma = np.sqrt(np.diagonal(reference.covariance(t), 0, 1, 2))
    return np.abs(difference) / (3 * sigma)


def compare(
    title: str,
    camera: StereoCamera,
    updates: list[Update],
    modes: dict[str, EstimatorConfig],
    front_end: float = 0.0,
) -> None:
    """Print cost and deviation of every mode; the front end takes some seconds a cluster."""
    seen = np.mean([len(measurements) for _, _, measurements, _ in updates])
    caption = f"{len(updates)} clusters of {seen:.0f} inliers, front end {1e3 * front_end:.1f} ms"
    table = Table(title=title, caption=caption)
    for heading in ("mode", "mean", "95 %", "max", "x real time", "with front end", "states"):
        table.add_column(heading, justify="right")
    table.add_column("from unique, % of 3 sigma", justify="right")
    duration = updates[-1][1] - updates[0][1]
    references = {
        window: timed(camera, updates, UNIQUE.model_copy(update={"window": window}))[0]
        for window in {config.window for config in modes.values()}
    }
    for name, config in modes.items():
        timed(camera, updates[:WARM_UP], config)
        trajectory, spent = timed(camera, updates, config)
        share = 100 * deviation(trajectory, references[config.window])
        table.add_row(
            name,
            f"{1e3 * spent.mean():.1f} ms",
            f"{1e3 * np.percentile(spent, 95):.1f} ms",
            f"{1e3 * spent.max():.1f} ms",
            f"{duration / spent.sum():.2f}",
            f"{duration / (spent + front_end).sum():.2f}",
            f"{len(trajectory)}",
            f"mean {share.mean():.2g}, max {share.max():.2g}",
        )
    console.print(table)


def long_stream(minutes: float, method: str) -> None:
    """Print processor time and memory of a long stream, minute by minute."""
    simulation, rng = TrackletSimulation(NoiseConfig()), np.random.default_rng(0)
    motion = simulation.motion(60 * minutes, rng)
    smoother = SMOOTHERS[method](simulation.camera, NoiseConfig(), STREAMED[method])
    title = f"{method}, {minutes:g} simulated minutes, {simulation.period * 1e3:g} ms clusters"
    table = Table(title=title)
    for heading in ("minute", "mean", "95 %", "max", "resident", "of it trajectory", "repairs"):
        table.add_column(heading, justify="right")
    spent: list[float] = []
    beyond: list[float] = []
    per_minute = round(60 / simulation.period)
    for frame, (stop, measurements) in enumerate(simulation.clusters(motion, rng)):
        began = time.process_time()
        smoother.update(frame, stop, measurements, None)
        spent.append(time.process_time() - began)
        if len(spent) == per_minute:
            milliseconds = 1e3 * np.array(spent)
            resident, stored = resident_megabytes(), smoother.stored_bytes / 1e6
            beyond.append(resident - stored)
            table.add_row(
                f"{len(beyond)}",
                f"{milliseconds.mean():.2f} ms",
                f"{np.percentile(milliseconds, 95):.2f} ms",
                f"{milliseconds.max():.2f} ms",
                f"{resident:.1f} MB",
                f"{stored:.1f} MB",
                f"{len(smoother.repairs)}",
            )
            spent.clear()
    console.print(table)
    if beyond:
        console.print(f"beyond the trajectory it grew by {beyond[-1] - beyond[0]:.1f} MB")


def resident_megabytes() -> float:
    """Memory of this process that is resident, MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return float(line.split()[1]) / 1e3
    return float("nan")


def simulated(seed: int, per_cluster: int, clusters: int) -> tuple[StereoCamera, list[Update]]:
    """The tracklets of a simulated motion."""
    simulation, rng = TrackletSimulation(NoiseConfig(), per_cluster), np.random.default_rng(seed)
    motion = simulation.motion(clusters * simulation.period, rng)
    stream = simulation.clusters(motion, rng)
    return simulation.camera, [(frame, *cluster, None) for frame, cluster in enumerate(stream)]


def main(
    clusters: Annotated[int, typer.Option(help="Clusters of each comparison.")] = 60,
    minutes: Annotated[float, typer.Option(help="Length of the long streams; 0: none.")] = 0.0,
    config: Annotated[Path | None, typer.Option(help="YAML of the front end.")] = None,
    mode: Annotated[list[str] | None, typer.Option(help="One of the estimators; all if none.")] = (
        None
    ),
    estimator: Annotated[
        list[str] | None, typer.Option(help="Of a long stream: gauss_newton, fixed_lag; both.")
    ] = None,
) -> None:
    """Compare the estimators on the same tracklets."""
    modes = {name: MODES[name] for name in mode or MODES}
    configuration = load_configuration(config) if config else Configuration()
    path = RECORDINGS / "room1_indoor1_data.hdf5"
    if not clusters:
        console.print("skipped the comparisons: no clusters")
    elif path.exists():
        calibration = RECORDINGS / "camchain-imucam-indoor_flying.yaml"
        recording = open_recording(path, calibration)
        camera, updates, front_end = tracklets_of(recording, configuration, clusters)
        compare("room1_indoor1", camera, updates, modes, front_end)
    else:
        console.print(f"skipped room1_indoor1: {path} is missing")
    if clusters:
        compare("simulated tracklets", *simulated(0, 20, clusters), modes)
    for method in (estimator or STREAMED) if minutes else ():
        # Each in a process of its own, that cannot take the memory that the one before freed.
        stream = get_context("spawn").Process(target=long_stream, args=(minutes, method))
        stream.start()
        stream.join()


if __name__ == "__main__":
    typer.run(main)
