"""What the estimators cost per cluster, and by how much their trajectories differ.

python -m benchmarks.smoother                  room1_indoor1, if it is there, and simulations
python -m benchmarks.smoother --minutes 10     and a long stream: memory and constant cost
python -m benchmarks.smoother --runs 20        and long tracks: accuracy beside GTSAM's own

GTSAM's own is its fixed-lag smoother with every landmark as a variable (`reference_smoother`).
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.reference_smoother import ReferenceSmoother, long_tracks, position_errors
from benchmarks.simulated_tracklets import TrackletSimulation
from factors import StereoCamera
from factors.lie import se3_inverse, se3_log
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig, load_configuration
from gpvo.estimator import Diagnostic, FixedLagSmoother, make_estimator, one_blas_thread
from gpvo.mc_ransac import VelocityFit
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.tracking import Measurements
from gpvo.trajectory import States, Trajectory

Array = NDArray[np.float64]
Update = tuple[float, Measurements, VelocityFit | None]

RECORDINGS = Path(__file__).parents[2] / "shared" / "recordings"
UNIQUE = EstimatorConfig()
REFERENCE = "GTSAM, landmarks as variables"
MODES: dict[str, EstimatorConfig | None] = {
    "fixed lag, unique times": UNIQUE,
    "fixed lag, key times 100 ms interpolated": EstimatorConfig(state_interval=0.1),
    "batch, key times 25 ms": EstimatorConfig(method="batch", state_interval=0.025),
    "batch, unique times": EstimatorConfig(method="batch"),
    REFERENCE: None,
}
"""The last has key states at the clusters' ends, and each of the others' lag."""
TRACKS = {
    "5 clusters": (5, 10, False),
    "20 clusters": (20, 3, False),
    "for ever": (1000, 2, False),
    "30 clusters, seen in every other three": (30, 3, True),
}
"""How long landmarks are measured, how many are new in each cluster, and if only now and then."""
SECONDS = 60
"""Of a row of the long stream."""
WARM_UP = 10
"""Clusters that compile the kernels before the clock starts."""

console = Console()


class Recorder:
    """An estimator that only remembers what it was given, and when."""

    def __init__(self) -> None:
        self.updates: list[Update] = []
        self.began: list[float] = []
        self.diagnostics: list[Diagnostic] = []
        self.states = States()

    def update(
        self,
        end_time: float,
        measurements: Measurements,
        velocity_estimate: VelocityFit | None = None,
    ) -> None:
        """Remember a cluster."""
        self.updates.append((end_time, measurements, velocity_estimate))
        self.began.append(time.process_time())

    def final_states(self, after: float = -np.inf) -> States:
        """There are none."""
        return States()

    def latest(self) -> None:
        """There is none."""

    def trajectory(self, start_ns: int = 0) -> None:
        """There is none."""


def tracklets_of(
    recording: Recording, configuration: Configuration, clusters: int
) -> tuple[StereoCamera, list[Update], float]:
    """The inlier tracklets of the first clusters, and the seconds that each took to get."""
    recorder = Recorder()
    odometry = Odometry(recording.rig, configuration, estimator=recorder)
    for _ in islice(odometry.reports_of(recording.event_batches()), clusters):
        pass
    front_end = float(np.mean(np.diff(recorder.began)[WARM_UP:]))
    return odometry.camera, recorder.updates, front_end


def timed(
    camera: StereoCamera, updates: Iterable[Update], config: EstimatorConfig | None, window: int
) -> tuple[Trajectory | States, Array]:
    """The trajectory, and the seconds of processor time that each update took.

    Of the reference, if there is no configuration. All is done in one thread: on a processor of
    its own these are seconds.
    """
    updates, noise = list(updates), NoiseConfig()
    lag = window * float(np.median(np.diff([end_time for end_time, *_ in updates])))
    estimator: Any = (
        ReferenceSmoother(camera, noise, lag)
        if config is None
        else make_estimator(camera, noise, config.model_copy(update={"window": window}))
    )
    spent = []
    with one_blas_thread():
        for update in updates:
            began = time.process_time()
            estimator.update(*update)
            spent.append(time.process_time() - began)
    return estimator.states if config is None else estimator.trajectory(), np.array(spent)


def deviation(found: Trajectory | States, reference: Trajectory) -> Array:
    """(N, 12) difference of pose and velocity, in shares of the reference's 3 sigma.

    Every 10 ms, relative to the first common time, where both are at the origin.
    """
    t = np.arange(reference.start, min(found.t[-1], reference.stop), 0.01)[1:]
    T, twist = found.query(t) if isinstance(found, States) else (found.pose(t), found.velocity(t))
    pose = se3_log(se3_inverse(reference.pose(t)) @ T)
    difference = np.hstack([pose, twist - reference.velocity(t)])
    sigma = np.sqrt(np.diagonal(reference.covariance(t), 0, 1, 2))
    return np.abs(difference) / (3 * sigma)


def compare(
    title: str,
    camera: StereoCamera,
    updates: list[Update],
    modes: dict[str, EstimatorConfig | None],
    front_end: float = 0.0,
    window: int = UNIQUE.window,
) -> None:
    """Print cost and deviation of every mode; the front end takes some seconds a cluster."""
    seen = np.mean([len(measurements) for _, measurements, _ in updates])
    caption = f"{len(updates)} clusters of {seen:.0f} inliers, front end {1e3 * front_end:.1f} ms"
    table = Table(title=title, caption=caption)
    for heading in ("mode", "mean", "95 %", "max", "x unique", "x real time", "with front end"):
        table.add_column(heading, justify="right")
    table.add_column("states", justify="right")
    table.add_column("from unique, % of 3 sigma", justify="right")
    duration = updates[-1][0] - updates[0][0]
    timed(camera, updates[:WARM_UP], UNIQUE, window)
    unique, unique_spent = timed(camera, updates, UNIQUE, window)
    assert isinstance(unique, Trajectory)
    for name, config in modes.items():
        try:
            timed(camera, updates[:WARM_UP], config, window)
            found, spent = timed(camera, updates, config, window)
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[0]
            table.add_row(name, *[""] * 7, f"failed: {reason}")
            continue
        share = 100 * deviation(found, unique)
        table.add_row(
            name,
            f"{1e3 * spent.mean():.1f} ms",
            f"{1e3 * np.percentile(spent, 95):.1f} ms",
            f"{1e3 * spent.max():.1f} ms",
            f"{spent.sum() / unique_spent.sum():.2f}",
            f"{duration / spent.sum():.2f}",
            f"{duration / (spent + front_end).sum():.2f}",
            f"{len(found.t)}",
            f"mean {share.mean():.2g}, max {share.max():.2g}",
        )
    console.print(table)


def compare_tracks(runs: int, duration: float = 2.0, window: int = UNIQUE.window) -> None:
    """Print position errors at the clusters' ends beside the reference's, by length of tracks."""
    table = Table(title=f"long tracks, {runs} runs of {duration:g} s, root mean square")
    for heading in ("tracks", "in a cluster", "fixed lag", "reference", "ratio of errors"):
        table.add_column(heading, justify="right")
    table.add_column("ratio of processor time", justify="right")
    for name, (length, per_cluster, revisits) in TRACKS.items():
        found: dict[str, list[Array]] = {"ours": [], "theirs": []}
        spent, seen = {"ours": 0.0, "theirs": 0.0}, []
        for seed in range(runs):
            simulation, motion, clusters = long_tracks(
                seed, length, per_cluster, duration, revisits
            )
            seen += [len(measurements) for _, measurements in clusters]
            t = np.array([end_time for end_time, _ in clusters])[9::5]
            ours = FixedLagSmoother(
                simulation.camera, simulation.noise, EstimatorConfig(window=window)
            )
            theirs = ReferenceSmoother(
                simulation.camera, simulation.noise, window * simulation.period
            )
            for who, smoother in (("ours", ours), ("theirs", theirs)):
                spent[who] += processor_time(smoother, clusters)
            trajectory = ours.trajectory()
            assert trajectory is not None
            states = States(trajectory.t, trajectory.T_world_cam, trajectory.twist)
            found["ours"].append(position_errors(states, motion, t))
            found["theirs"].append(position_errors(theirs.states, motion, t))
        rms = {who: float(np.sqrt(np.mean(np.square(errors)))) for who, errors in found.items()}
        table.add_row(
            name,
            f"{np.mean(seen):.0f}",
            f"{1e3 * rms['ours']:.2f} mm",
            f"{1e3 * rms['theirs']:.2f} mm",
            f"{rms['ours'] / rms['theirs']:.3f}",
            f"{spent['ours'] / spent['theirs']:.2f}",
        )
    console.print(table)


def processor_time(
    smoother: FixedLagSmoother | ReferenceSmoother, clusters: Iterable[tuple[float, Measurements]]
) -> float:
    """Update a smoother with clusters; return the seconds of the processor."""
    began = time.process_time()
    with one_blas_thread():
        for cluster in clusters:
            smoother.update(*cluster)
    return time.process_time() - began


def long_stream(minutes: float) -> None:
    """Print processor time and memory of a long stream, minute by minute."""
    simulation, rng = TrackletSimulation(NoiseConfig()), np.random.default_rng(0)
    motion = simulation.motion(60 * minutes, rng)
    smoother = FixedLagSmoother(simulation.camera)
    title = f"fixed lag, {minutes:g} simulated minutes, {simulation.period * 1e3:g} ms clusters"
    table = Table(title=title)
    for heading in ("minute", "mean", "95 %", "max", "resident", "of it trajectory", "left out"):
        table.add_column(heading, justify="right")
    spent: list[float] = []
    beyond: list[float] = []
    per_minute = round(SECONDS / simulation.period)
    for cluster in simulation.clusters(motion, rng):
        began = time.process_time()
        smoother.update(*cluster)
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
                f"{len(smoother.diagnostics)}",
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
    return simulation.camera, [(*cluster, None) for cluster in stream]


def main(
    clusters: Annotated[int, typer.Option(help="Clusters of each comparison.")] = 60,
    minutes: Annotated[float, typer.Option(help="Length of the long stream; 0: none.")] = 0.0,
    runs: Annotated[int, typer.Option(help="Runs of long tracks; 0: none.")] = 0,
    config: Annotated[Path | None, typer.Option(help="YAML of the front end.")] = None,
    mode: Annotated[list[str] | None, typer.Option(help="One of the estimators; all if none.")] = (
        None
    ),
) -> None:
    """Compare the estimators on the same tracklets."""
    for name in mode or ():
        if name not in MODES:
            raise typer.BadParameter(f"--mode {name}: known are {', '.join(MODES)}")
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
    if runs:
        compare_tracks(runs)
    if minutes:
        # In a process of its own, that cannot take the memory that was freed before.
        stream = get_context("spawn").Process(target=long_stream, args=(minutes,))
        stream.start()
        stream.join()


if __name__ == "__main__":
    typer.run(main)
