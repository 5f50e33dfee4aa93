"""Are the smoothers' covariances honest? Mean NEES over many simulated runs, as a plot.

python -m benchmarks.consistency --runs 100 --output consistency.png
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from benchmarks.simulated_tracklets import TrackletSimulation
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import make_estimator, one_blas_thread
from gpvo.evaluation.metrics.nees import mean_nees_interval, nees

Array = NDArray[np.float64]
DURATION = 0.75
MODES = {
    "fixed lag, unique times": EstimatorConfig(),
    "fixed lag, key times 100 ms": EstimatorConfig(state_interval=0.1),
}


def run_nees(seed: int, config: EstimatorConfig, t: Array) -> tuple[Array, Array]:
    """NEES (N,) of pose and velocity at times t (N,) of one simulated run."""
    noise, rng = NoiseConfig(track_drift=0.0), np.random.default_rng(seed)
    simulation = TrackletSimulation(noise)
    motion = simulation.motion(DURATION, rng)
    smoother = make_estimator(simulation.camera, noise, config)
    with one_blas_thread():
        for end_time, measurements in simulation.clusters(motion, rng):
            smoother.update(end_time, measurements)
    trajectory = smoother.trajectory()
    assert trajectory is not None
    return nees(trajectory, motion, t)


def mean_nees(runs: int, config: EstimatorConfig, t: Array) -> Array:
    """(2, N) mean NEES of pose and velocity over runs with the seeds 0 to runs - 1."""
    return np.mean([run_nees(seed, config, t) for seed in range(runs)], axis=0)


def save_plot(path: Path, t: Array, means: dict[str, Array], runs: int) -> None:
    """The mean NEES over time of each mode and the interval that it should lie in."""
    from matplotlib.figure import Figure

    low, high = mean_nees_interval(runs)
    figure = Figure(figsize=(7, 2.5 * len(means)), layout="constrained")
    panels = figure.subplots(len(means), sharex=True, squeeze=False)[:, 0]
    for axes, (mode, lines) in zip(panels, means.items(), strict=True):
        axes.axhspan(low, high, color="0.9", label="95 % interval")
        axes.axhline(6, color="0.6", linewidth=0.8)
        for name, line in zip(("pose", "velocity"), lines, strict=True):
            axes.plot(t, line, marker=".", label=name)
        axes.set(title=mode, ylabel="mean NEES", ylim=(0, 2 * high))
    panels[-1].set_xlabel(f"time (s), {runs} runs")
    panels[-1].legend(loc="lower right", ncols=3, frameon=False)
    figure.savefig(path, dpi=150)


def main(
    runs: Annotated[int, typer.Option(min=1, help="Simulated runs.")] = 100,
    output: Annotated[Path, typer.Option(help="Plot.")] = Path("consistency.png"),
) -> None:
    """Simulate, estimate, compare the errors with the covariances."""
    t = np.linspace(0.1, 0.7, 49)  # every fourth is a cluster's end
    t_between = np.arange(len(t)) % 4 != 0
    low, high = mean_nees_interval(runs)
    print(f"95 % interval of the mean NEES of {runs} runs: {low:.2f} to {high:.2f}")
    means = {mode: mean_nees(runs, config, t) for mode, config in MODES.items()}
    for mode, lines in means.items():
        for name, line in zip(("pose", "velocity"), lines, strict=True):
            for where, part in (("clusters' ends", line[::4]), ("between", line[t_between])):
                inside = np.mean((part > low) & (part < high))
                print(
                    f"{mode}, {name}, {where}: mean over time {part.mean():.2f}, from"
                    f" {part.min():.2f} to {part.max():.2f}, inside at {100 * inside:.0f} % of"
                    f" {len(part)} times"
                )
    save_plot(output, t, means, runs)


if __name__ == "__main__":
    typer.run(main)
