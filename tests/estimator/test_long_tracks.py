"""Landmarks that are measured for long, and again: against GTSAM with every one a variable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from runs import fed, states_of

from benchmarks.reference_smoother import ReferenceSmoother, long_tracks, position_errors
from gpvo.config import EstimatorConfig
from gpvo.estimator import FixedLagSmoother, one_blas_thread

WINDOW = 5
SEEDS = 5


@pytest.mark.parametrize(
    "length, per_cluster, revisits",
    [(5, 8, False), (20, 3, False), (1000, 2, False), (30, 3, True)],
)
def test_positions_are_as_good_as_with_landmarks_in_the_graph(
    length: int, per_cluster: int, revisits: bool
) -> None:
    """At the clusters' ends, where both have states; on average over some runs."""
    ours, theirs = [], []
    for seed in range(SEEDS):
        simulation, motion, clusters = long_tracks(seed, length, per_cluster, 1.25, revisits)
        camera, noise = simulation.camera, simulation.noise
        t = np.array([end_time for end_time, _ in clusters])[9::5]
        smoother = FixedLagSmoother(camera, noise, EstimatorConfig(window=WINDOW))
        states = states_of(fed(smoother, clusters))
        assert not smoother.diagnostics
        ours.append(position_errors(states, motion, t))
        reference = ReferenceSmoother(camera, noise, WINDOW * simulation.period)
        with one_blas_thread():
            for cluster in clusters:
                reference.update(*cluster)
        theirs.append(position_errors(reference.states, motion, t))
    assert root_mean_square(ours) < 1.05 * root_mean_square(theirs)


def root_mean_square(errors: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def test_landmarks_are_known_again_after_a_gap_that_is_longer_than_the_window() -> None:
    """Where they have new names, what is measured afterwards says nothing of the gap."""
    gap, errors = range(9, 9 + 2 * WINDOW), {}
    for renamed in (0, 1_000_000):
        errors[renamed] = []
        for seed in range(SEEDS):
            simulation, motion, clusters = long_tracks(seed, 1000, 8, 1.25)
            smoother = FixedLagSmoother(
                simulation.camera, simulation.noise, EstimatorConfig(window=WINDOW)
            )
            for number, (end_time, seen) in enumerate(clusters):
                named = seen.landmark + renamed * (number >= gap.stop)
                known = replace(seen, landmark=named)
                smoother.update(end_time, known[:0] if number in gap else known)
            t = np.array([end_time for end_time, _ in clusters])[gap.stop + 2 :]
            trajectory = smoother.trajectory()
            assert trajectory is not None and not smoother.diagnostics
            errors[renamed].append(position_errors(states_of(trajectory), motion, t))
    assert root_mean_square(errors[0]) < 0.5 * root_mean_square(errors[1_000_000])
