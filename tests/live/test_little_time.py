"""What is estimated while time is short: with less, and over breaks, it stays usable."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from factors.lie import se3_inverse
from gpvo import Odometry, Trajectory
from gpvo.config import Configuration
from gpvo.events.clustering import WIDEST
from gpvo.live.load import FEWEST
from gpvo.recordings import StereoEvents
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate


@cache
def room(seed: int = 5) -> SimulatedRecording:
    config = SimulationConfig(
        seed=seed, duration=2.4, resolution=(240, 180), focal_length=160.0, noise_rate=1.0
    )
    return simulate(config)


def run(
    is_there: Callable[[float], bool], features: float = 1.0, spacing: float = 1.0, seed: int = 5
) -> tuple[Odometry, Trajectory]:
    """Estimate the motion from the events of times that are there."""
    odometry, recording = Odometry(room(seed).rig), room(seed)
    odometry.relieve(features, spacing)
    for start in np.arange(0.0, recording.duration, 0.01).tolist():
        sides = (side.between(start, start + 0.01) for side in (recording.left, recording.right))
        if is_there(start):
            list(odometry.push(StereoEvents(start, start + 0.01, *sides)))
    list(odometry.end())
    trajectory = odometry.trajectory()
    assert trajectory is not None
    return odometry, trajectory


def off(trajectory: Trajectory, t: NDArray[np.float64], seed: int = 5) -> NDArray[np.float64]:
    """Return how far the path is from the true one at times t (N,), metres."""
    motion = room(seed).motion
    start = se3_inverse(motion.pose(np.array([trajectory.start]))[0])
    found, true = (
        (se3_inverse(trajectory.pose([trajectory.start])[0]) @ trajectory.pose(t)),
        (start @ motion.pose(t)),
    )
    return np.linalg.norm(found[:, :3, 3] - true[:, :3, 3], axis=1)


def test_with_a_quarter_of_the_time_and_half_of_the_features_the_path_is_nearly_as_good() -> None:
    seeds = range(5, 7)  # one room may be lucky
    wholes = [run(lambda t: True, seed=seed) for seed in seeds]
    leasts = [run(lambda t: True, FEWEST, WIDEST, seed) for seed in seeds]
    (whole, _), (least, _) = wholes[0], leasts[0]
    events, used = len(room().left) + len(room().right), sum(r.events for r in least.reports)
    assert used < 0.35 * events and len(least.reports) < 0.6 * len(whole.reports)
    assert sum(report.between for report in least.reports) > 0.6 * events
    assert all(report.inliers > 20 for report in least.reports[2:-1])  # the last has few
    inliers = np.array([report.inliers for one, _ in leasts for report in one.reports[2:]])
    assert np.median(inliers) > 60 and np.mean(inliers > 20) > 0.8
    t = np.linspace(0.1, 2.2, 50)
    all_of_it, part = (
        np.mean([off(path, t, seed).max() for (_, path), seed in zip(runs, seeds, strict=True)])
        for runs in (wholes, leasts)
    )
    assert part < 3 * all_of_it


@pytest.mark.parametrize("seed", range(5, 8))
@pytest.mark.parametrize("length", [0.7, 1.2])
def test_after_a_break_the_motion_is_right_and_the_place_as_the_covariance_says(
    length: float, seed: int
) -> None:
    start = 0.8
    t = np.array([start + length + 0.15, 2.3])
    _, trajectory = run(lambda t: not start <= t < start + length, seed=seed)
    motion = room(seed).motion
    error = np.linalg.norm((trajectory.velocity(t) - motion.twist(t))[:, 3:], axis=1)
    assert (error < 0.15).all()
    found, moved = (
        np.linalg.norm(np.diff(each[:, :3, 3], axis=0))
        for each in (trajectory.pose(t), motion.pose(t))
    )
    assert abs(found - moved) < 0.03
    deviation = np.sqrt(np.trace(trajectory.covariance(t)[1, 3:6, 3:6]))
    assert off(trajectory, t, seed)[1] < 3 * deviation + 0.02


@pytest.mark.parametrize(("features", "all_of_it"), [(200, False), (1000, True)])
def test_all_events_are_taken_where_fewer_landmarks_agree_than_half(
    features: int, all_of_it: bool
) -> None:
    values = {"tracking": {"klt": {"max_features": features, "usual_features": features}}}
    odometry = Odometry(room().rig, Configuration.model_validate(values))
    odometry.run(room())
    assert all(report.inliers < 500 for report in odometry.reports)
    assert all(report.between == 0 for report in odometry.reports) == all_of_it
