"""What the estimators cost per cluster, and by how much their trajectories differ.

python -m benchmarks.smoother                  room1_indoor1, if it is there, and simulations
python -m benchmarks.smoother --minutes 10     and a long stream: memory and constant cost
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from factors import StereoCamera
from factors.lie import se3_inverse, se3_log
from gpvo.clustering import cluster_events
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig
from gpvo.configuration_file import load_configuration
from gpvo.estimators import make_estimator
from gpvo.gauss_newton_smoother import GaussNewtonSmoother
from gpvo.mc_ransac import VelocityFit
from gpvo.odometry import Odometry
from gpvo.recordings import open_recording
from gpvo.recordings.base import Recording
from gpvo.repairs import Repair
from gpvo.simulation.tracklets import TrackletSimulation
from gpvo.tracklets import Measurements
from gpvo.trajectory import Trajectory

Array = NDArray[np.float64]
Update = tuple[int, float, Measurements, VelocityFit | None]

RECORDINGS = Path(__file__).parents[2] / "shared" / "recordings"
MODES = {
    "key times, 25 ms": EstimatorConfig(state_interval=0.025),
    "unique times": EstimatorConfig(state_interval=0.0),
    "key times, GTSAM": EstimatorConfig(method="fixed_lag", state_interval=0.025),
    "unique times, GTSAM by QR": EstimatorConfig(method="fixed_lag", state_interval=0.0),
    "key times, batch": EstimatorConfig(method="batch", state_interval=0.025),
    "unique times, batch": EstimatorConfig(method="batch", state_interval=0.0),
}
WARM_UP = 10
"""Clusters that compile the kernels before the clock starts."""

console = Console()


class Recorder:
    """An estimator that only remembers what it was given."""

    def __init__(self) -> None:
        self.updates: list[Update] = []
        self.repairs: list[Repair] = []

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> None:
        """Remember a cluster."""
        self.updates.append((frame, stop, measurements, fit))

    def trajectory(self, start_ns: int) -> None:
        """There is none."""


def tracklets_of(
    recording: Recording, configuration: Configuration
) -> tuple[StereoCamera, list[Update]]:
    """The inlier tracklets of all clusters of a recording."""
    odometry, recorder = Odometry(recording.rig, configuration), Recorder()
    odometry.estimator = recorder
    clustering = odometry.configuration.clustering
    for cluster in cluster_events(recording.slabs(), recording.rig, clustering):
        odometry.process(cluster)
    return odometry.camera, recorder.updates


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
    title: str, camera: StereoCamera, updates: list[Update], modes: dict[str, EstimatorConfig]
) -> None:
    """Print cost and deviation of every mode."""
    table = Table(title=title)
    for heading in ("mode", "mean", "95 %", "x real time", "states", "from unique, % of 3 sigma"):
        table.add_column(heading, justify="right")
    duration = updates[-1][1] - updates[0][1]
    reference, _ = timed(camera, updates, MODES["unique times"])
    for name, config in modes.items():
        timed(camera, updates[:WARM_UP], config)
        trajectory, spent = timed(camera, updates, config)
        share = 100 * deviation(trajectory, reference)
        table.add_row(
            name,
            f"{1e3 * spent.mean():.1f} ms",
            f"{1e3 * np.percentile(spent, 95):.1f} ms",
            f"{duration / spent.sum():.2f}",
            f"{len(trajectory)}",
            f"mean {share.mean():.2g}, max {share.max():.2g}",
        )
    console.print(table)


def long_stream(minutes: float) -> None:
    """Print processor time and memory of a long stream, minute by minute."""
    simulation, rng = TrackletSimulation(NoiseConfig()), np.random.default_rng(0)
    motion = simulation.motion(60 * minutes, rng)
    smoother = GaussNewtonSmoother(simulation.camera, NoiseConfig(), EstimatorConfig())
    table = Table(title=f"{minutes:g} simulated minutes, {simulation.period * 1e3:g} ms clusters")
    for heading in ("minute", "mean", "95 %", "resident", "of it trajectory"):
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
                f"{resident:.1f} MB",
                f"{stored:.1f} MB",
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
    minutes: Annotated[float, typer.Option(help="Length of the long stream; 0: none.")] = 0.0,
    config: Annotated[Path | None, typer.Option(help="YAML of the front end.")] = None,
    mode: Annotated[list[str] | None, typer.Option(help="One of the estimators; all if none.")] = (
        None
    ),
) -> None:
    """Compare the estimators on the same tracklets."""
    modes = {name: MODES[name] for name in mode or MODES}
    configuration = load_configuration(config) if config else Configuration()
    path = RECORDINGS / "room1_indoor1_data.hdf5"
    if path.exists():
        calibration = RECORDINGS / "camchain-imucam-indoor_flying.yaml"
        camera, updates = tracklets_of(open_recording(path, calibration), configuration)
        compare("room1_indoor1", camera, updates[:clusters], modes)
    else:
        console.print(f"skipped room1_indoor1: {path} is missing")
    compare("simulated tracklets", *simulated(0, 20, clusters), modes)
    if minutes:
        long_stream(minutes)


if __name__ == "__main__":
    typer.run(main)
