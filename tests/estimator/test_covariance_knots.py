"""Covariances of final states that a later estimate of their end moves on."""

from __future__ import annotations

import numpy as np
import pytest
from runs import POINTS, estimate, fed
from synthetic import tracklets

from benchmarks.simulated_tracklets import TrackletSimulation
from gpvo.config import EstimatorConfig
from gpvo.estimator import make_estimator
from gpvo.evaluation.metrics.nees import mean_nees_interval, nees
from gpvo.trajectory import CovarianceKnots


def chain(rng: np.random.Generator, count: int) -> np.ndarray:
    """(12 count, 12 count) covariance of a chain, each state of which depends on the last one."""
    steps = 0.5 * rng.standard_normal((count, 12, 12))
    root = np.zeros((12 * count, 12 * count))
    for k in range(count):
        now = slice(12 * k, 12 * k + 12)
        if k:
            root[now] = steps[k] @ root[12 * k - 12 : 12 * k]
        root[now, now] += np.eye(12)
    return root @ root.T


def test_a_piece_whose_end_moves_is_as_uncertain_as_its_errors() -> None:
    """Against the covariance of all errors together, after the end's correction is passed on."""
    rng, t = np.random.default_rng(0), np.array([0.0, 0.3, 0.5, 1.0])
    P = chain(rng, 4)
    pairs = np.array([P[12 * k : 12 * k + 24, 12 * k : 12 * k + 24] for k in range(3)])
    knots = CovarianceKnots(t, pairs)
    learned = rng.standard_normal((12, 12))
    end = P[36:, 36:]
    after = np.linalg.inv(np.linalg.inv(end) + learned.T @ learned)
    joint = np.eye(24)[None].copy()
    joint[0, :12, :12] = after
    moved = knots.followed_by(CovarianceKnots(np.array([1.0, 2.0]), joint))
    # The correction and each knot's error before it: cov(e, c) = cov(e, e_end) P^-1 C.
    C = end - after
    cross = P[:, 36:] @ np.linalg.solve(end, C)
    weights = []
    for a in t:  # a cubic from zero to the end's value and slope
        weights.append(
            np.kron(
                [[3 * a**2 - 2 * a**3, a**3 - a**2], [6 * a - 6 * a**2, 3 * a**2 - 2 * a]],
                np.eye(6),
            )
        )
    W = np.vstack(weights)
    expected = P - cross @ W.T - W @ cross.T + W @ C @ W.T
    for k in range(3):
        pair = slice(12 * k, 12 * k + 24)
        assert np.allclose(moved.joint[k], expected[pair, pair], atol=1e-9)
    assert np.allclose(moved.joint[-1, 12:, 12:], after)


def test_a_piece_whose_end_stays_stays() -> None:
    P = chain(np.random.default_rng(1), 3)
    pairs = np.array([P[:24, :24], P[12:, 12:]])
    knots = CovarianceKnots(np.array([0.0, 0.4]), pairs[:1])
    later = CovarianceKnots(np.array([0.4, 1.0]), pairs[1:])
    assert np.allclose(knots.followed_by(later).joint, knots.joint, atol=1e-12)


@pytest.mark.parametrize("interval", [0.0, 0.1])
def test_velocities_between_final_states_are_honest(interval: float) -> None:
    """Mean NEES at the middle of clusters that have left the window one after the other."""
    runs, values = 14, []
    config = EstimatorConfig(window=4, state_interval=interval)
    for seed in range(runs):
        rng, simulation = np.random.default_rng(seed), TrackletSimulation(POINTS, 6)
        motion = simulation.motion(0.5, rng)
        estimator = make_estimator(simulation.camera, POINTS, config)
        trajectory = fed(estimator, simulation.clusters(motion, rng))
        values.append(nees(trajectory, motion, np.array([0.125, 0.175, 0.225]))[1])
    low, high = mean_nees_interval(runs, 0.99)
    mean = np.mean(values, axis=0)
    assert ((mean > low) & (mean < high)).all(), mean


@pytest.mark.parametrize("interval", [0.0, 0.1])
def test_knots_are_states(interval: float) -> None:
    """A knot at each key state; between these at unique times, a few milliseconds apart."""
    trajectory = estimate(tracklets(clusters=9, noise=0.3), window=4, state_interval=interval)
    knots = trajectory.t[trajectory.knots]
    ends = 0.05 * np.arange(1, 10)
    assert (np.abs(knots[:, None] - ends).min(axis=0) < 1e-9).all()
    if interval:
        assert len(knots) == 1 + len(ends)
    else:
        assert len(knots) > 1.5 * len(ends)
        assert np.diff(knots).max() < 0.05
