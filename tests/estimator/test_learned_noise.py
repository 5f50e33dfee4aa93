"""Noise learned while the smoother runs, against the noise that tracklets were made with."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import wnoa_square_root_covariance
from factors.lie import se3_exp, se3_right_jacobian
from factors.wnoa import information_root
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig
from gpvo.config.automatic import VARIANCES, scaled
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.initialization import InitialState
from gpvo.estimator.isam2 import prior_covariance
from gpvo.estimator.measurement_noise import ALIKE, EVEN, MeasurementNoise
from gpvo.estimator.motion_noise import (
    MotionNoise,
    acceleration_changes,
    axis_variances,
    change_jacobian,
    white_jacobian,
    wnoa_errors,
)
from gpvo.trajectory.states import States

START = np.array(NoiseConfig().acceleration_psd)


def random_states(qc: np.ndarray, count: int, seed: int = 0, dt: float = 0.05) -> States:
    """Draw states of the WNOA process."""
    rng, T, twist = np.random.default_rng(seed), [np.eye(4)], [np.zeros(6)]
    root = wnoa_square_root_covariance(dt, qc)
    for _ in range(count - 1):
        deviation = root @ rng.standard_normal(12)
        xi = dt * twist[-1] + deviation[:6]
        T.append(T[-1] @ se3_exp(xi))
        twist.append(se3_right_jacobian(xi) @ (twist[-1] + deviation[6:]))
    return States(dt * np.arange(count), np.array(T), np.array(twist))


def learned(simulated: NoiseConfig, given: NoiseConfig, seconds: float = 3.0) -> NoiseConfig:
    """Return what a smoother that was given one noise learns of tracklets of another."""
    simulation, rng = TrackletSimulation(simulated, per_cluster=30), np.random.default_rng(1)
    smoother = FixedLagSmoother(simulation.camera, given)
    for end_time, measurements in simulation.clusters(simulation.motion(seconds, rng), rng):
        smoother.update(end_time, measurements)
    return smoother.noise


def test_errors_of_the_prior_are_those_that_the_states_were_made_with() -> None:
    states = random_states(START, 30)
    errors = wnoa_errors(states)
    twist = np.array([0.1, -0.2, 0.3, 1.0, 0.0, -1.0])
    still = States(
        np.arange(4.0), np.stack([se3_exp(k * twist) for k in range(4)]), np.tile(twist, (4, 1))
    )
    np.testing.assert_allclose(wnoa_errors(still), 0.0, atol=1e-12)
    assert errors.shape == (29, 2, 6)


@pytest.mark.parametrize("scale", [0.3, 1.0, 100.0])
def test_known_states_tell_the_scale_of_each_component(scale: float) -> None:
    """Without uncertainty the estimate is the mean of 12 N squares, chi-squared distributed."""
    qc = START * np.repeat([scale, 1.0], 3)
    noise = MotionNoise(START, memory=1e6)
    noise.learn(random_states(qc, 1000), np.zeros((12000, 12000)))
    ratio = noise.qc / START
    np.testing.assert_allclose(ratio, np.repeat([scale, 1.0], 3), rtol=4 * np.sqrt(2 / 6000))


def white_errors(states: States) -> np.ndarray:
    """Whitened errors (K - 1, 2, 6) of the prior, unit Q_c."""
    return np.einsum("kab,kbi->kai", information_root(np.diff(states.t)), wnoa_errors(states))


def white_changes(states: States) -> np.ndarray:
    """Changes (K - 2, 2, 6) of the whitened errors."""
    white = white_errors(states)
    return acceleration_changes(white[:-1], white[1:], np.diff(states.t))


def test_a_constant_acceleration_has_no_changes() -> None:
    t = np.cumsum([0.0, 0.05, 0.03, 0.06, 0.01, 0.05, 0.05])
    axis, acceleration = np.array([0.3, -0.2, 0.1, 2.0, 1.0, -3.0]), 0.5
    T = se3_exp(0.5 * acceleration * t[:, None] ** 2 * axis)
    states = States(t, T, acceleration * t[:, None] * axis)
    assert np.abs(wnoa_errors(states)).max() > 0.05
    np.testing.assert_allclose(white_changes(states), 0.0, atol=1e-12)


def test_accelerations_that_alternate_count_for_more_than_their_size() -> None:
    """Their changes are twice as large, in squares, as those of white noise."""
    t = 0.05 * np.arange(40)
    velocity = np.cumsum((-1.0) ** np.arange(40))[:, None] * np.full(6, 0.05)
    T = [np.eye(4)]
    for before, after in pairwise(velocity):
        T.append(T[-1] @ se3_exp(0.025 * (before + after)))
    states = States(t, np.array(T), velocity)
    squares = wnoa_errors(states)[:, 1, 0].var() / 0.05 / 2  # whitened, it is in two values
    noise = MotionNoise(np.full(6, squares), memory=1e6)
    noise.learn(states, np.zeros((480, 480)))
    ratio = noise.qc / squares
    assert (ratio > 1.5).all() and (ratio < 2.5).all()


def test_variances_of_errors_and_changes_are_those_of_numerical_jacobians() -> None:
    states, rng = random_states(START, 4, dt=0.02), np.random.default_rng(5)
    dt = np.diff(states.t)

    def moved(delta: np.ndarray) -> States:
        by_state = delta.reshape(-1, 2, 6)
        T = states.T_world_cam @ se3_exp(by_state[:, 0])
        return States(states.t, T, states.twist + by_state[:, 1])

    root = rng.standard_normal((48, 48)) * np.tile(np.repeat([1e-4, 1e-2], 6), 4)[:, None]
    covariance, of_errors = root @ root.T, white_jacobian(states, information_root(dt))
    for values, jacobian in (
        (white_errors, of_errors),
        (white_changes, change_jacobian(of_errors, dt)),
    ):
        steps = 1e-6 * np.eye(48)
        columns = [(values(moved(step)) - values(moved(-step))) / 2e-6 for step in steps]
        numerical = np.stack(columns, axis=-1)
        expected = np.einsum("kaij,jl,kail->ki", numerical, covariance, numerical)
        np.testing.assert_allclose(axis_variances(jacobian, covariance), expected, rtol=0.02)


def test_states_as_uncertain_as_the_prior_teach_nothing() -> None:
    """Where the posterior is the prior, no error remains and the redundancy is zero."""
    noise = MotionNoise(START, memory=1.0)
    t = np.array([0.0, 0.1, 0.15])
    states = States(t, np.tile(np.eye(4), (3, 1, 1)), np.zeros((3, 6)))
    noise.learn(states, prior_covariance(np.zeros((12, 12)), t, START.tolist()))
    np.testing.assert_allclose(noise.qc, START, rtol=1e-9)


@pytest.mark.parametrize("scale", [10.0, 100.0])
def test_the_smoother_finds_a_livelier_motion(scale: float) -> None:
    true = NoiseConfig(acceleration_psd=tuple(scale * START), track_drift=0.0)
    found = learned(true, NoiseConfig(track_drift=0.0, motion_memory=1.0), 0.8)
    ratio = np.array(found.acceleration_psd) / true.acceleration_psd
    assert (ratio > 0.4).all() and (ratio < 2.5).all()
    assert found.measurement_information == true.measurement_information


@pytest.mark.parametrize("weight", [0.5, 2.0])
def test_variances_count_as_the_cube_root_of_the_rate(weight: float) -> None:
    """Of the measurements' own, their root counts besides."""
    errors = [MeasurementNoise(np.ones(3), 1.0) for _ in range(2)]
    for noise, dt in zip(errors, (EVEN / weight**3, EVEN), strict=True):
        noise.learn(0.0, np.ones((10, 3)), 20, dt)
    one, even = errors
    assert (even.variance_factor, one.variance_factor) == (1.0, pytest.approx(weight))
    np.testing.assert_allclose(one.information, even.information / weight**1.5)


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_scaled_noise_has_the_same_estimate_and_scaled_covariances(factor: float) -> None:
    noise = NoiseConfig(track_drift=0.1)
    simulation, rng = TrackletSimulation(noise, per_cluster=30), np.random.default_rng(1)
    clusters = list(simulation.clusters(simulation.motion(1.0, rng), rng))
    initial, config = InitialState.at_origin(noise), EstimatorConfig(state_interval=0.05, gate=0)
    priors = initial, replace(initial, covariance=factor * initial.covariance)
    found = []
    for given, prior in zip((noise, scaled(noise, VARIANCES, factor)), priors, strict=True):
        smoother = FixedLagSmoother(simulation.camera, given, config, prior)
        for end_time, measurements in clusters:
            smoother.update(end_time, measurements)
        latest = smoother.latest()
        assert latest is not None
        found.append(latest)
    np.testing.assert_allclose(found[1].T_world_cam, found[0].T_world_cam, atol=1e-6)
    np.testing.assert_allclose(found[1].covariance, factor * found[0].covariance, rtol=1e-3)


@pytest.mark.parametrize("deviation", [0.5, 3.0])
def test_the_smoother_finds_the_scale_of_the_measurements(deviation: float) -> None:
    """Independent errors, which tracks do not have, count sqrt(ALIKE / dt) times all the same."""
    start = NoiseConfig(track_drift=0.0, measurement_memory=5.0)
    information = tuple(x / deviation**2 for x in start.measurement_information)
    found = learned(start.model_copy(update={"measurement_information": information}), start)
    ratio = np.array(information) / found.measurement_information
    period = TrackletSimulation(start).period
    np.testing.assert_allclose(ratio, np.sqrt(ALIKE / period), rtol=0.25)


def test_given_noise_is_kept() -> None:
    given = NoiseConfig(track_drift=0.0)
    assert learned(NoiseConfig(initial_velocity=0.3), given, 1.0) == given


def test_a_jerk_after_rest_is_followed_at_once() -> None:
    noise = MotionNoise(START, memory=1.0)
    tiny = np.eye(36) * 1e-12
    for number in range(40):
        rest = random_states(1e-4 * START, 3, number)
        noise.learn(States(rest.t + 0.05 * number, rest.T_world_cam, rest.twist), tiny)
    at_rest = noise.qc
    jerk = random_states(1e3 * START, 3, 99)
    noise.learn(States(jerk.t + 2.0, jerk.T_world_cam, jerk.twist), tiny)
    assert (at_rest <= 0.11 * START).all() and (noise.qc > 10 * START).all()


def test_noise_is_learned_by_default_and_not_in_the_papers_way() -> None:
    automatic, paper = (
        Configuration().noise,
        Configuration.model_validate({"preset": "paper"}).noise,
    )
    assert automatic.motion_memory > 0 and automatic.measurement_memory > 0
    assert paper.motion_memory == 0 and paper.measurement_memory == 0
