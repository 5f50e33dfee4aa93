"""What leaves the window leaves all that it knew: fixed lag against one batch of everything.

With little noise, so that all linearise at the same motion, and the smoother's prior is exact.
"""

from __future__ import annotations

from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X
from runs import METHODS, NOTHING, PERIOD, POINTS, difference, estimate
from runs import states_of as states_in
from synthetic import CAMERA, constant_velocity, tracklets

from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig
from gpvo.estimator.batch_graph import Window, nested_dissection
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.tracking import Measurements, seen_twice
from gpvo.trajectory import Trajectory

TINY = 0.01
"""Noise, pixels."""
MICROMETRE = 1e-6


def seen_again(clusters: int, gap: int, count: int = 30) -> list[Measurements]:
    """Landmarks that are measured in two clusters, not in the `gap` after these, and so on."""
    rng = np.random.default_rng(4)
    stereo = rng.uniform([100, 100, 8], [240, 160, 20], (count, 3))
    points, twist = CAMERA.triangulate(stereo), 0.2 * np.array([0.1, -0.2, 0.15, 0.3, -0.1, 0.4])
    parts = []
    for cluster in range(clusters):
        seen = np.flatnonzero((cluster + np.arange(count)) % (gap + 2) < 2)
        t = np.round((cluster + rng.random(len(seen))) * PERIOD, 6)
        T = constant_velocity(t, twist)
        local = np.einsum("nji,nj->ni", T[:, :3, :3], points[seen] - T[:, :3, 3])
        measured = CAMERA.project(local) + TINY * rng.standard_normal((len(seen), 3))
        parts.append(Measurements(seen, np.full(len(seen), cluster), t, measured))
    return parts


def long_tracks(clusters: int = 10) -> list[Measurements]:
    """Landmarks that are measured in all clusters, most of which have left the window."""
    return seen_again(clusters, gap=0, count=12)


def few_clusters_each(clusters: int = 10) -> list[Measurements]:
    return tracklets(clusters, per_cluster=10, noise=TINY)


CASES = {
    "four clusters": few_clusters_each(),
    "every cluster": long_tracks(),
    "again and again": seen_again(10, gap=1),
    "with a gap": [*few_clusters_each()[:6], NOTHING, *few_clusters_each()[7:]],
}


@cache
def of_everything(case: str, interval: float) -> Trajectory:
    return estimate(CASES[case], POINTS, window=100, state_interval=interval)


@pytest.mark.parametrize("interval", [0.0, 0.025, 0.1])
@pytest.mark.parametrize("window", [3, 4])
@pytest.mark.parametrize("case", CASES)
def test_states_that_stay_are_those_of_a_window_of_everything(
    case: str, window: int, interval: float
) -> None:
    """To a few micrometres; and as certain."""
    parts, everything = CASES[case], of_everything(case, interval)
    trajectory = estimate(parts, POINTS, window=window, state_interval=interval)
    assert np.array_equal(trajectory.t, everything.t)
    t = trajectory.t[trajectory.t > (len(parts) - window + 1) * PERIOD]
    apart = difference(trajectory, everything, t)
    assert np.linalg.norm(apart[:, 3:6], axis=1).max() < 5 * MICROMETRE
    assert np.abs(apart[:, :3]).max() < 5e-6
    assert np.abs(apart[:, 6:]).max() < 2e-5
    ours, theirs = (np.diagonal(x.covariance(t), 0, 1, 2) for x in (trajectory, everything))
    assert np.allclose(ours, theirs, rtol=5e-3)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("interval", [0.0, 0.1])
def test_information_is_that_of_a_batch_over_all_measurements(case: str, interval: float) -> None:
    """However often the factor was replaced: nothing counts twice, and nothing is lost.

    The batch is GTSAM's, of all states and all landmarks as variables.
    """
    parts = CASES[case][:7]
    trajectory = estimate(parts, POINTS, window=4, state_interval=interval)
    t = trajectory.t if interval == 0 else trajectory.t[np.isin(trajectory.t, ends(parts))]
    used = seen_twice(Measurements.concatenate(parts))
    first = np.diag(np.repeat([1e-6, POINTS.initial_velocity], 6) ** 2)
    config = EstimatorConfig(relative_decrease=1e-9)
    window = Window(states_in(trajectory).at(t), used, first)
    build = GraphBuilder(CAMERA, POINTS, config)
    expected = last_covariance(window, build)
    scale = np.sqrt(np.diag(expected))
    apart = (trajectory.covariance(trajectory.stop) - expected) / np.outer(scale, scale)
    assert np.abs(apart).max() < 5e-3
    best = window.optimize(build)
    moved = se3_log(se3_inverse(best.T_world_cam[-1]) @ trajectory.T_world_cam[-1])
    moved = np.concatenate([moved, trajectory.twist[-1] - best.twist[-1]])
    assert (np.abs(moved) / scale).max() < 0.05


def last_covariance(window: Window, build: GraphBuilder) -> np.ndarray:
    """(12, 12) of the last state, by QR: all else is eliminated before."""
    last = len(window.states) - 1
    found = nested_dissection(range(last + 1), window.states.t, window.measurements)
    before, after = gtsam.Ordering(), gtsam.Ordering()
    for key in (X(last), V(last)):
        after.push_back(key)
    for i in range(found.size()):
        if found.at(i) not in (X(last), V(last)):
            before.push_back(found.at(i))
    linear = window.graph(build).linearize(window.values(build))
    _, left = linear.eliminatePartialMultifrontal(before, gtsam.EliminateQR)
    root, _ = left.jacobian(after)
    return np.linalg.inv(root.T @ root)


def ends(parts: list[Measurements]) -> np.ndarray:
    """Times of key states: the first measurement and the clusters' ends."""
    first = min(part.t.min() for part in parts if len(part))
    return np.append(first, PERIOD * np.arange(1, len(parts) + 1))


def test_a_wider_window_is_worth_more_to_the_batch_window_alone() -> None:
    """It forgets what it measured before; the smoother does not."""
    variances = {
        (method, window): np.diagonal(
            estimate(long_tracks(), POINTS, method=method, window=window).covariance(0.48)
        )
        for method in METHODS
        for window in (3, 100)
    }
    fixed, batch = (variances[m, 3] / variances[m, 100] for m in METHODS)
    assert np.allclose(fixed, 1, rtol=0.01)
    assert (batch[6:] > 1.05).any()
