"""The newest priors are about the acceleration that the motion had before them."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from runs import NOTHING
from test_window_motion import priors

from benchmarks.simulated_tracklets import TrackletSimulation
from factors.lie import se3_exp
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.acceleration_ahead import AHEAD, AccelerationAhead, mean_acceleration
from gpvo.estimator.motion_noise import wnoa_errors
from gpvo.trajectory import States

Array = NDArray[np.float64]
ACCELERATION = np.array([0.6, -0.4, 0.3, 2.0, -1.0, 0.5])
ABOUT_ZERO = NoiseConfig(track_drift=0.0, motion_memory=0.5)
ABOUT_MEAN = ABOUT_ZERO.model_copy(update={"acceleration_memory": 6.0})


def accelerated(duration: float, back: float = np.inf) -> States:
    """A motion whose twist grows with time, and falls again after `back` seconds."""
    t = np.arange(0, duration + 1e-9, 0.005)
    twist = np.where(t < back, t, 2 * back - t)[:, None] * ACCELERATION
    xi = 0.5 * (twist[1:] + twist[:-1]) * np.diff(t)[:, None]
    T = list(accumulate(se3_exp(xi), np.matmul, initial=np.eye(4)))
    return States(t, np.array(T), twist)


def errors_at_the_end(noise: NoiseConfig, motion: States) -> Array:
    """Errors (K, 6) of the newest twist after each cluster but the first ones."""
    simulation, rng = TrackletSimulation(ABOUT_ZERO, per_cluster=12), np.random.default_rng(1)
    smoother, errors = FixedLagSmoother(simulation.camera, noise, EstimatorConfig()), []
    for end_time, new in simulation.clusters(motion, rng):
        smoother.update(end_time, new)
        newest = smoother.latest()
        assert newest is not None
        errors.append(newest.twist - motion.query(np.array([newest.t]))[1][0])
    return np.array(errors[6:])


def test_the_newest_velocity_is_not_behind_that_of_a_steady_acceleration() -> None:
    motion = accelerated(0.8)
    behind, found = (errors_at_the_end(noise, motion) for noise in (ABOUT_ZERO, ABOUT_MEAN))
    lag = behind.mean(axis=0) / ACCELERATION
    assert lag[3] < -0.02  # seconds
    assert np.abs(found.mean(axis=0)[3:]).max() < 0.2 * np.abs(behind.mean(axis=0)[3:]).max()


def test_a_turn_is_not_passed_by_far() -> None:
    """What was seen before it is wrong after it, for as long as nothing else was seen."""
    motion = accelerated(0.9, back=0.5)
    behind, found = (errors_at_the_end(noise, motion) for noise in (ABOUT_ZERO, ABOUT_MEAN))
    worst = np.linalg.norm(behind, axis=1).max(), np.linalg.norm(found, axis=1).max()
    assert worst[1] < 1.5 * worst[0]


@pytest.mark.parametrize("noise", [ABOUT_ZERO, ABOUT_MEAN])
def test_priors_of_the_latest_updates_are_about_a_mean(noise: NoiseConfig) -> None:
    simulation, rng = TrackletSimulation(ABOUT_ZERO, per_cluster=12), np.random.default_rng(1)
    smoother = FixedLagSmoother(simulation.camera, noise, EstimatorConfig(state_interval=1.0))
    for end_time, new in simulation.clusters(accelerated(0.6), rng):
        smoother.update(end_time, new)
    *earlier, one, newest = (prior.acceleration.any() for prior in priors(smoother))
    assert AHEAD == 2 and not any(earlier)
    assert one == newest == (noise is ABOUT_MEAN)


def test_where_the_motion_is_guessed_it_is_not_accelerated() -> None:
    simulation, rng = TrackletSimulation(ABOUT_ZERO, per_cluster=12), np.random.default_rng(1)
    smoother = FixedLagSmoother(simulation.camera, ABOUT_MEAN, EstimatorConfig(bridge=0.3))
    for end_time, new in simulation.clusters(accelerated(1.2), rng):
        smoother.update(end_time, new if end_time < 0.6 else NOTHING)
    assert not any(prior.acceleration.any() for prior in priors(smoother))


@given(st.integers(3, 8), st.integers(0, 2**32 - 1))
def test_twists_that_grow_with_time_have_their_slope_as_acceleration(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t, slope, start = np.cumsum(rng.uniform(0.01, 0.1, count)), rng.normal(size=6), rng.normal()
    states = States(t, np.tile(np.eye(4), (count, 1, 1)), start + t[:, None] * slope)
    np.testing.assert_allclose(mean_acceleration(states, 10.0), slope, atol=1e-9)
    assert not mean_acceleration(states, t[-1] - t[-3] - 1e-3).any()
    assert not mean_acceleration(states[:0], 1.0).any()


def test_only_the_latest_two_times_have_a_mean() -> None:
    ahead, known = AccelerationAhead(6.0), accelerated(1.0)
    for k in range(4):
        ahead.extend(known, 1.0 + 0.1 * k, 1.1 + 0.1 * k)
    mean = ahead.between(1.0 + 0.05 * np.arange(10))
    np.testing.assert_allclose(mean[4:8], np.tile(ACCELERATION, (4, 1)), rtol=1e-9)
    assert not mean[:4].any() and not mean[8:].any()
    assert ahead.between(np.array([1.35])).shape == (0, 6)


def test_errors_about_the_mean_of_a_steady_acceleration_are_zero() -> None:
    """Up to what the twist's own direction changes, of third order in time."""
    motion = accelerated(0.1)
    errors = wnoa_errors(motion, np.tile(ACCELERATION, (len(motion) - 1, 1)))
    assert np.abs(errors).max() < 1e-3 * np.abs(wnoa_errors(motion)).max()


def test_it_is_on_by_default_and_off_in_the_paper() -> None:
    assert Configuration().noise.acceleration_memory == 6.0
    assert Configuration.model_validate({"preset": "paper"}).noise.acceleration_memory == 0.0
