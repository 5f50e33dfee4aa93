"""Landmarks that are measured for long, and again: against GTSAM with every one a variable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from runs import fed, states_of

from benchmarks.reference_smoother import ReferenceSmoother, long_tracks, position_errors
from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig
from gpvo.estimator import FixedLagSmoother, one_blas_thread
from gpvo.tracking import Measurements
from gpvo.trajectory import States, Trajectory

WINDOW = 5
SEEDS = 3


@pytest.mark.parametrize(
    "length, per_cluster, revisits",
    [(5, 8, False), (1000, 2, False), (30, 3, True)],
)
def test_positions_are_as_good_as_with_landmarks_in_the_graph(
    length: int, per_cluster: int, revisits: bool
) -> None:
    """At the clusters' ends, where both have states; on average over some runs."""
    ours, theirs = [], []
    for seed in range(SEEDS):
        simulation, motion, clusters = long_tracks(seed, length, per_cluster, 1.0, revisits)
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


AWAY = range(9, 9 + 2 * WINDOW)
AWAY_SEEDS = 5


def with_some_away(clusters: list[tuple[float, Measurements]]) -> list[tuple[float, Measurements]]:
    """Half of the landmarks are away for longer than the window; the others have short lives."""
    changed = []
    for number, (end_time, seen) in enumerate(clusters):
        stays = seen.landmark % 2 == 0
        name = np.where(stays, seen.landmark, seen.landmark + 1_000_000 * (1 + number // 3))
        kept = ~stays if number in AWAY else np.ones(len(seen), bool)
        changed.append((end_time, replace(seen, landmark=name)[kept]))
    return changed


def after_some_were_away(lost_landmarks: int, seed: int) -> tuple[Trajectory, States, np.ndarray]:
    """Trajectory, true motion, and times after landmarks came back."""
    simulation, motion, clusters = long_tracks(seed, 1000, 12, 1.25)
    config = EstimatorConfig(window=WINDOW, lost_landmarks=lost_landmarks)
    smoother = FixedLagSmoother(simulation.camera, simulation.noise, config)
    trajectory = fed(smoother, with_some_away(clusters))
    assert not smoother.diagnostics
    return trajectory, motion, np.array([end for end, _ in clusters])[AWAY.stop + 2 :]


def test_landmarks_that_were_away_hold_the_motion_when_they_come_back() -> None:
    """What the motion has drifted since then is known; and the covariance says how well."""
    errors: dict[int, list[np.ndarray]] = {0: [], 300: []}
    nees = []
    for seed in range(AWAY_SEEDS):
        for lost_landmarks, found in errors.items():
            trajectory, motion, t = after_some_were_away(lost_landmarks, seed)
            found.append(position_errors(states_of(trajectory), motion, t))
        start = motion.query(trajectory.t[:1])[0][0]
        T_true = se3_inverse(start) @ motion.query(t[-1:])[0][0]
        error = se3_log(se3_inverse(trajectory.pose(t[-1])) @ T_true)
        covariance = trajectory.covariance(t[-1])[:6, :6]
        nees.append(error @ np.linalg.solve(covariance, error) / 6)
    assert root_mean_square(errors[300]) < 0.7 * root_mean_square(errors[0])
    assert np.mean(nees) < 1.46  # the 95 % bound for 30 degrees of freedom


def test_memory_is_bounded() -> None:
    """Not more landmarks are remembered than asked for, and those that were measured latest."""
    simulation, _, clusters = long_tracks(0, 5, 8, 1.25)
    count = []
    for lost_landmarks in (0, 20):
        config = EstimatorConfig(window=WINDOW, lost_landmarks=lost_landmarks)
        smoother = FixedLagSmoother(simulation.camera, simulation.noise, config)
        fed(smoother, clusters)
        number, latest = smoother.landmarks[0], clusters[-1][1].landmark
        count.append(len(number))
        assert np.isin(np.unique(latest), number).mean() > 0.5
    assert count[0] + 14 <= count[1] <= count[0] + 20
