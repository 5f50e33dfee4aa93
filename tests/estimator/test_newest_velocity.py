"""How certain the newest velocities are follows what later updates make of those before."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks.simulated_tracklets import TrackletSimulation
from factors.lie import se3_exp
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.acceleration_ahead import AHEAD
from gpvo.estimator.newest_velocity import ONE_LATER, NewestVelocity
from gpvo.trajectory import States
from gpvo.trajectory.smooth_motion import velocity_scale

Array = NDArray[np.float64]
POINTS = {"track_drift": 0.0, "motion_memory": 0.5, "acceleration_memory": 6.0}
TWIST = np.array([0.1, -0.05, 0.02, 0.3, 0.1, 0.2])
WHITE, SMOOTH = (NoiseConfig(**POINTS, velocity_share=share) for share in (1.0, 0.25))


def learned(factor: float, updates: int, seed: int = 0, memory: float = 1e3) -> NewestVelocity:
    """Of newest twists that are off by a factor times what their covariance says.

    An update takes a second. The deviation of a twist is its axis' own, and 0.4 times it once it
    is known.
    """
    rng, newest = np.random.default_rng(seed), NewestVelocity(memory)
    deviation = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    better = 0.4 * deviation
    off = factor * np.sqrt(deviation**2 - better**2)
    truth = better * rng.standard_normal((updates + AHEAD, 6))  # as known in the end
    for k in range(AHEAD, updates + AHEAD):
        twist = truth[k - AHEAD : k + 1].copy()
        twist[-1] += off * rng.standard_normal(6)
        variance = np.tile(np.concatenate([np.ones(6), better**2]), (AHEAD + 1, 1))
        variance[-1, 6:] = deviation**2
        t = np.arange(k - AHEAD, k + 1, dtype=float)
        newest.learn(
            States(t, np.tile(np.eye(4), (len(t), 1, 1)), twist), np.diag(variance.ravel())
        )
        newest.end(float(k), is_guessed=False)
    return newest


@settings(deadline=None, max_examples=20)
@given(st.floats(0.1, 5.0), st.integers(0, 1000))
def test_it_is_what_the_corrections_are_beyond_their_covariance(factor: float, seed: int) -> None:
    assert learned(factor, 500, seed).scale == pytest.approx(factor, rel=0.1)


def test_it_begins_with_what_the_covariances_say() -> None:
    assert learned(3.0, AHEAD).scale == 1.0
    assert 1.0 < learned(3.0, AHEAD + 1).scale < 3.0


def test_it_forgets() -> None:
    """What was seen an e-th ago counts 1/e: errors of 3 among ones of 1, as time goes on."""
    long, short = (learned(3.0, 60, memory=memory).scale for memory in (1e3, 0.3))
    assert 1.0 < short < long


def test_a_guessed_motion_is_not_compared_and_not_scaled() -> None:
    newest = learned(3.0, 100)
    before = newest.scale
    newest.forget()
    t = np.array([200.0, 201.0])
    newest.learn(States(t, np.tile(np.eye(4), (2, 1, 1)), np.full((2, 6), 9.0)), np.eye(24))
    newest.end(201.0, is_guessed=True)
    assert newest.scale == 1.0
    newest.end(202.0, is_guessed=False)
    assert newest.scale == before


def test_the_latest_updates_have_it_and_smooth_motion_has_it_all_along() -> None:
    rough, smooth = learned(2.0, 200), learned(0.2, 200)
    t = np.arange(10.0, 201.1, 0.25)  # the latest update ended at 201 s
    end, amid = t >= 199.0, (t > 50.0) & (t < 199.0)
    for newest in (rough, smooth):
        scale = newest.at(t, 0.25)
        assert scale[-1] == newest.scale
        np.testing.assert_allclose(scale[end & (t <= 200.0)], np.sqrt(ONE_LATER) * newest.scale)
        assert (np.diff(scale[t >= 200.0]) > 0).all()
    np.testing.assert_array_equal(rough.at(t, 0.25)[amid], 0.5)
    assert (smooth.at(t, 0.25)[amid] < 0.3).all()
    np.testing.assert_array_equal(rough.at(t, 0.25)[:2], 1.0)


def test_without_memory_nothing_is_learned() -> None:
    newest, t = NewestVelocity(0.0), np.arange(100.0)
    newest.end(3.0, is_guessed=False)
    assert not newest.learns and newest.scale == 1.0
    np.testing.assert_array_equal(newest.at(t, 0.25), velocity_scale(t, 0.25))


def run(noise: NoiseConfig, motion: States, prepare: bool = False) -> FixedLagSmoother:
    simulation, rng = TrackletSimulation(SMOOTH, per_cluster=12), np.random.default_rng(1)
    smoother = FixedLagSmoother(simulation.camera, noise, EstimatorConfig())
    for end_time, new in simulation.clusters(motion, rng):
        smoother.update(end_time, new)
        if prepare:
            smoother.prepare()
    return smoother


def moving(share: Callable[[Array], Array]) -> States:
    """A motion whose twist is a share of TWIST that changes with time, for 0.8 s."""
    t = np.arange(0.0, 0.8 + 1e-9, 0.005)
    twist = share(t)[:, None] * TWIST
    steps = se3_exp(0.5 * (twist[1:] + twist[:-1]) * np.diff(t)[:, None])
    return States(t, np.array(list(accumulate(steps, np.matmul, initial=np.eye(4)))), twist)


def ratio(motion: States) -> Array:
    """Variances (6,) of the newest velocity, relative to those of white noise."""
    smooth, white = (run(noise, motion).latest() for noise in (SMOOTH, WHITE))
    assert smooth is not None and white is not None
    np.testing.assert_array_equal(smooth.twist, white.twist)
    np.testing.assert_array_equal(smooth.covariance[:6, :6], white.covariance[:6, :6])
    np.testing.assert_array_equal(smooth.by_prior().covariance, white.covariance)
    return np.diagonal(smooth.covariance)[6:] / np.diagonal(white.covariance)[6:]


def test_steady_motion_is_more_certain_than_white_noise_and_turns_are_less() -> None:
    steady, turning = ratio(moving(np.ones_like)), ratio(moving(lambda t: np.sin(20.0 * t)))
    for scale in (steady, turning):
        np.testing.assert_allclose(scale, scale[0])
    assert steady[0] < 0.7 and turning[0] > 1.3


def test_it_is_the_same_whether_an_update_was_prepared() -> None:
    late, early = (run(SMOOTH, moving(np.cos), prepare) for prepare in (False, True))
    paths = late.trajectory(), early.trajectory()
    assert paths[0] is not None and paths[1] is not None
    np.testing.assert_array_equal(paths[0].velocity_scale, paths[1].velocity_scale)
    newest = late.latest(), early.latest()
    assert newest[0] is not None and newest[1] is not None
    np.testing.assert_array_equal(newest[0].covariance, newest[1].covariance)


def test_the_paper_has_none() -> None:
    noise = Configuration.model_validate({"preset": "paper"}).noise
    path = run(noise, moving(np.cos)).trajectory()
    assert path is not None
    np.testing.assert_array_equal(path.velocity_scale, 1.0)
