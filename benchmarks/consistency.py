"""Are the smoother's covariances honest? Mean NEES over many simulated runs, as a plot.

python -m benchmarks.consistency --runs 100 --output consistency.png
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.consistency import mean_nees_interval, nees
from gpvo.gauss_newton_smoother import GaussNewtonSmoother
from gpvo.simulation.tracklets import TrackletSimulation

Array = NDArray[np.float64]
DURATION = 0.75


def run_nees(seed: int, config: EstimatorConfig, t: Array) -> tuple[Array, Array]:
    """NEES (N,) of pose and velocity at times t (N,) of one simulated run."""
    noise, rng = NoiseConfig(), np.random.default_rng(seed)
    simulation = TrackletSimulation(noise)
    motion = simulation.motion(DURATION, rng)
    smoother = GaussNewtonSmoother(simulation.camera, noise, config)
    for frame, (stop, measurements) in enumerate(simulation.clusters(motion, rng)):
        smoother.update(frame, stop, measurements, None)
    trajectory = smoother.trajectory(0)
    assert trajectory is not None
    return nees(trajectory, motion, t)


def mean_nees(runs: int, config: EstimatorConfig, t: Array) -> Array:
    """(2, N) mean NEES of pose and velocity over runs with the seeds 0 to runs - 1."""
    return np.mean([run_nees(seed, config, t) for seed in range(runs)], axis=0)


def save_plot(path: Path, t: Array, means: Array, runs: int) -> None:
    """The mean NEES over time and the interval that it should lie in."""
    from matplotlib.figure import Figure

    low, high = mean_nees_interval(runs)
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    axes = figure.subplots()
    axes.axhspan(low, high, color="0.9", label="95 % interval")
    axes.axhline(6, color="0.6", linewidth=0.8)
    for name, line in zip(("pose", "velocity"), means, strict=True):
        axes.plot(t, line, marker=".", label=name)
    axes.set(xlabel="time (s)", ylabel=f"mean NEES of {runs} runs", ylim=(0, 2 * high))
    axes.legend(loc="lower right", ncols=3, frameon=False)
    figure.savefig(path, dpi=150)


def main(
    runs: Annotated[int, typer.Option(min=1, help="Simulated runs.")] = 100,
    output: Annotated[Path, typer.Option(help="Plot.")] = Path("consistency.png"),
) -> None:
    """Simulate, estimate, compare the errors with the covariances."""
    t = np.linspace(0.1, DURATION, 14)
    means = mean_nees(runs, EstimatorConfig(), t)
    low, high = mean_nees_interval(runs)
    inside = (means > low) & (means < high)
    print(f"95 % interval of the mean NEES of {runs} runs: {low:.2f} to {high:.2f}")
    for name, line, share in zip(("pose", "velocity"), means, inside.mean(axis=1), strict=True):
        print(
            f"{name}: mean over time {line.mean():.2f}, from {line.min():.2f} to {line.max():.2f},"
            f" inside at {100 * share:.0f} % of {len(t)} times"
        )
    save_plot(output, t, means, runs)


if __name__ == "__main__":
    typer.run(main)
