"""A robot in the plane: Pose2 states with white noise on jerk, beacons ranged at some of them.

It drives a bend and measures its distance to three beacons, one at a time. The motion prior ties
the states together and tells pose, velocity and acceleration at any time. Run as ``python -m
examples.planar_robot``; with a file name it also saves a plot.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, V, X
from numpy.typing import NDArray

from factors import WnojPriorFactorPose2, optimize

Array = NDArray[np.float64]

QC = np.array([0.1, 0.01, 0.1])  # power spectral density of the jerk: x, y, angle
BEACONS = np.array([[4.0, 6.0], [-3.0, 4.0], [2.0, -3.0]])  # metres
STATES = [(X(k), V(k), A(k), 0.2 * k) for k in range(31)]  # keys and seconds
STEP = 1e-3


def truth(duration: float) -> Array:
    """True (x, y, angle) every millisecond: it speeds up and turns in, from rest."""
    found = [np.zeros(3)]
    for k in range(round(duration / STEP)):
        t = k * STEP
        x, y, angle = found[-1]
        speed, turn = 1.2 * (1 - np.cos(t)) / 2, 0.6 * np.sin(0.5 * t)
        step = np.array([speed * np.cos(angle), speed * np.sin(angle), turn])
        found.append(np.array([x, y, angle]) + STEP * step)
    return np.array(found)


def build(path: Array, rng: np.random.Generator) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The graph, and a robot that stays where it is."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    tight, noise = (gtsam.noiseModel.Isotropic.Sigma(*each) for each in ((3, 1e-3), (1, 0.02)))
    graph.add(gtsam.PriorFactorPose2(X(0), gtsam.Pose2(), tight))
    graph.add(gtsam.PriorFactorVector(V(0), np.zeros(3), tight))
    for pose, velocity, acceleration, _ in STATES:
        values.insert(pose, gtsam.Pose2())
        values.insert(velocity, np.zeros(3))
        values.insert(acceleration, np.zeros(3))
    for state_i, state_j in pairwise(STATES):
        graph.add(WnojPriorFactorPose2(state_i, state_j, QC))
    for n, beacon in enumerate(BEACONS):
        graph.add(gtsam.PriorFactorPoint2(gtsam.symbol("b", n), beacon, noise_of_beacon()))
        values.insert(gtsam.symbol("b", n), beacon)
    for k, (pose, _, _, t) in enumerate(STATES):
        here = gtsam.Pose2(*path[round(t / STEP)])
        measured = here.range(BEACONS[k % 3]) + 0.02 * rng.normal()
        graph.add(gtsam.RangeFactor2D(pose, gtsam.symbol("b", k % 3), measured, noise))
    return graph, values


def noise_of_beacon() -> gtsam.noiseModel.Base:
    return gtsam.noiseModel.Isotropic.Sigma(2, 1e-3)


def main(plot: Path | None = None) -> tuple[Array, Array]:
    """Return estimated and true positions (n, 2), every 20 ms."""
    path = truth(STATES[-1][-1])
    graph, values = build(path, np.random.default_rng(0))
    solved = optimize(graph, values, gtsam.LevenbergMarquardtParams())
    positions, times = [], np.arange(0, STATES[-1][-1], 0.02).round(3)
    for t in times:
        before = min(int(t / 0.2 + 1e-9), len(STATES) - 2)
        prior = WnojPriorFactorPose2(STATES[before], STATES[before + 1], QC)
        pose, _, _ = prior.interpolate(solved, max(t - STATES[before][-1], 0.0))
        positions.append([pose.x(), pose.y()])
    found, expected = np.array(positions), path[np.round(times / STEP).astype(int), :2]
    errors = np.linalg.norm(found - expected, axis=1)
    print(f"{len(expected)} positions, mean error {1e2 * errors.mean():.1f} cm")
    if plot:
        save_plot(plot, found, expected)
    return found, expected


def save_plot(path: Path, found: Array, expected: Array) -> None:
    """Both paths from above, and the beacons."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 5), layout="constrained")
    axes = figure.subplots()
    axes.plot(*expected.T, label="true")
    axes.plot(*found.T, "--", label="estimated")
    axes.plot(*BEACONS.T, "^", label="beacons")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
