"""Noise learned while the smoother runs, against the noise that tracklets were made with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import wnoa_square_root_covariance
from factors.lie import se3_adjoint, se3_exp, se3_inverse, se3_right_jacobian
from factors.wnoa import information_root
from gpvo.config import Configuration, EstimatorConfig, NoiseConfig
from gpvo.config.automatic import scaled
from gpvo.estimator import FixedLagSmoother, one_blas_thread
from gpvo.estimator.initialization import InitialState
from gpvo.estimator.isam2 import prior_covariance
from gpvo.estimator.measurement_noise import ALIKE, MeasurementNoise
from gpvo.estimator.motion_noise import (
    MotionNoise,
    axis_jacobians,
    interval_sums,
    wnoa_errors,
)
from gpvo.trajectory.states import States

START = np.array(NoiseConfig().acceleration_psd)
VARIANCES = {"acceleration_psd": 1, "measurement_information": -1, "track_drift": 0.5}
"""Fields of the noise and the powers of a variance that they have."""


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


def white_errors(states: States) -> np.ndarray:
    """Whitened errors (K - 1, 2, 6) of the prior, unit Q_c."""
    return np.einsum("kab,kbi->kai", information_root(np.diff(states.t)), wnoa_errors(states))


def moved(states: States, delta: np.ndarray) -> States:
    """Move states by perturbations (12 K,)."""
    by_state = delta.reshape(-1, 2, 6)
    T = states.T_world_cam @ se3_exp(by_state[:, 0])
    return States(states.t, T, states.twist + by_state[:, 1])


def at_rest(count: int, dt: float = 0.05) -> States:
    """Return states that do not move, whose axes are independent."""
    T = np.tile(np.eye(4), (count, 1, 1))
    return States(dt * np.arange(count), T, np.zeros((count, 6)))


class Measured:
    """Linear measurements of states near rest, unit noise, rows `H` (6, m, 2 K) of each axis."""

    def __init__(self, rest: States, H: np.ndarray) -> None:
        self.rest, self.H, size = rest, H, len(rest)
        whole = axis_jacobians(rest, information_root(np.diff(rest.t)))
        axes = whole.reshape(6, -1, size, 2, 6)
        own = np.stack([axes[axis, ..., axis] for axis in range(6)])
        self.jacobian = own.reshape(6, -1, 2 * size)

    def estimate(self, z: np.ndarray, qc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return perturbations (6, 2 K) of z (6, m) and their covariances (6, 2 K, 2 K)."""
        J, H = self.jacobian, self.H
        information = J.swapaxes(1, 2) @ J / qc[:, None, None] + H.swapaxes(1, 2) @ H
        covariance = np.linalg.inv(information)
        return np.einsum("aij,amj,am->ai", covariance, H, z), covariance

    def risk(self, z: np.ndarray, qc: np.ndarray) -> np.ndarray:
        """Stein's unbiased estimate (6,) of |A z - E z|^2, up to a constant."""
        perturbation, covariance = self.estimate(z, qc)
        left = z - np.einsum("amj,aj->am", self.H, perturbation)
        smoother = self.H @ covariance @ self.H.swapaxes(1, 2)
        return (left**2).sum(axis=1) + 2 * np.trace(smoother, axis1=1, axis2=2)

    def sums(self, z: np.ndarray, qc: np.ndarray) -> np.ndarray:
        """Return `interval_sums` of the estimate."""
        perturbation, of_axes = self.estimate(z, qc)
        size = len(self.rest)
        covariance = np.zeros((size, 2, 6, size, 2, 6))
        for axis in range(6):
            covariance[:, :, axis, :, :, axis] = of_axes[axis].reshape(size, 2, size, 2)
        states = moved(self.rest, perturbation.reshape(6, size, 2).transpose(1, 2, 0).ravel())
        return interval_sums(states, covariance.reshape(12 * size, -1), self.rest, qc)


def test_the_sums_are_the_derivative_of_steins_estimate_of_the_risk() -> None:
    rng, qc = np.random.default_rng(3), 1e-9 * np.array([1.0, 2.0, 5.0, 10.0, 20.0, 0.5])
    measured = Measured(at_rest(4), 1e5 * rng.standard_normal((6, 9, 8)))
    z, step = 3 * rng.standard_normal((6, 9)), 1e-4
    numerical = (measured.risk(z, qc * np.exp(step)) - measured.risk(z, qc / np.exp(step))) / step
    squares, weight = measured.sums(z, qc).sum(axis=2)
    np.testing.assert_allclose(-4 * (squares - weight), numerical, rtol=1e-3, atol=1e-4)


def test_the_risk_is_least_where_nothing_is_learned() -> None:
    """Sums over many draws of noise and motion: the estimate is best with the true Q_c."""
    rng, true = np.random.default_rng(4), np.full(6, 1e-9)
    rest = at_rest(30)
    poses = np.zeros((6, 30, 60))
    poses[:, np.arange(30), 2 * np.arange(30)] = 1e6
    measured = Measured(rest, poses)
    total = np.zeros(2)
    with one_blas_thread():
        for _ in range(40):
            white = rng.standard_normal((6, 58)) * np.sqrt(true)[:, None]
            motion = np.linalg.lstsq(measured.jacobian[0], white.T, rcond=None)[0].T
            z = np.einsum("amj,aj->am", poses, motion) + rng.standard_normal((6, 30))
            total += measured.sums(z, true).sum(axis=(1, 2))
    assert total[0] / total[1] == pytest.approx(1.0, abs=0.05)


def test_accelerations_count_where_the_smoother_begins_to_leave_them_away() -> None:
    """Slower ones are followed whatever Q_c is, and quicker ones are lost."""
    rest, qc = at_rest(40), np.full(6, 1e-9)
    poses = np.zeros((6, 40, 80))
    poses[:, np.arange(40), 2 * np.arange(40)] = 2e6
    measured, found = Measured(rest, poses), []
    for hertz in (0.5, 2.0, 8.0):
        velocity = 5e-6 * np.cumsum(np.sin(2 * np.pi * hertz * rest.t))
        motion = np.ravel(np.stack([0.05 * np.cumsum(velocity), velocity], axis=1))
        squares, weight = measured.sums(poses @ motion, qc).sum(axis=2)
        found.append(squares / weight)
    slow, middle, quick = found
    assert (middle > 10 * slow).all() and (middle > 10 * quick).all()


def test_what_all_poses_have_in_common_is_no_error() -> None:
    """The sums are the same however uncertain the whole path is in the world."""
    rng, states = np.random.default_rng(8), random_states(10 * START, 6)
    root = 1e-5 * rng.standard_normal((72, 72))
    common = np.zeros((6, 2, 6, 6))
    common[:, 0] = se3_adjoint(se3_inverse(states.T_world_cam))
    whole = common.reshape(72, 6)
    sums = [
        interval_sums(states, covariance, states, START)
        for covariance in (root @ root.T, root @ root.T + whole @ whole.T)
    ]
    assert (sums[0][1] > 0).any()
    np.testing.assert_allclose(sums[1], sums[0], rtol=1e-5, atol=1e-9)


def test_jacobians_are_numerical_ones() -> None:
    states = random_states(START, 4, dt=0.02)
    root = information_root(np.diff(states.t))
    steps = 1e-6 * np.eye(48)
    numerical = np.stack(
        [(white_errors(moved(states, d)) - white_errors(moved(states, -d))) / 2e-6 for d in steps],
        axis=-1,
    )
    expected = numerical.transpose(2, 0, 1, 3).reshape(6, 6, 48)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(axis_jacobians(states, root), expected, atol=0.02 * scale)


def half_known(count: int) -> tuple[np.ndarray, States]:
    """Return a covariance with which half of every error is known, and where it was found."""
    rest = at_rest(count)
    return 0.5 * prior_covariance(np.zeros((12, 12)), rest.t, START.tolist()), rest


@pytest.mark.parametrize("scale", [0.3, 1.0, 100.0])
def test_axes_have_their_own_density(scale: float) -> None:
    """Where half of every error is known, its estimate's variance is half of Q_c."""
    of_axes = np.array([scale, 1.0, scale, 1.0, scale, 1.0])
    noise = MotionNoise(START, memory=1e6)
    noise.learn(random_states(0.5 * START * of_axes, 150), *half_known(150))
    ratio, largest = noise.qc / START / of_axes, of_axes == max(scale, 1.0)
    np.testing.assert_allclose(ratio[largest], 1.0, rtol=4 * np.sqrt(2 / 298))
    assert (ratio[~largest] < 5.0).all()  # the mean of the axes counts a little


def test_intervals_that_stay_are_learned_anew() -> None:
    """Their last estimate alone counts."""
    states = random_states(10 * START, 8)
    covariance, rest = half_known(8)
    often, once = MotionNoise(START, memory=1e6), MotionNoise(START, memory=1e6)
    often.learn(random_states(START, 8, seed=1), covariance, rest)
    sums = interval_sums(states, covariance, rest, often.qc)
    sums[0] *= (often.qc / START)[:, None]
    often.learn(states, covariance, rest)
    once.learn(states, covariance, rest)
    np.testing.assert_allclose(often.qc, once.qc, rtol=0.4)  # P is relative to Q_c
    assert (often._past == 0.0).all()
    np.testing.assert_allclose(often._window, sums)


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
def test_variances_count_as_the_root_of_the_rate(weight: float) -> None:
    usual, other = (MeasurementNoise(np.ones(3), 1.0) for _ in range(2))
    for noise, dt in ((usual, 0.1), (other, 0.1 / weight**2)):
        noise.learn(0.0, np.ones((10, 3)), 20, dt)
    np.testing.assert_allclose(other.information, usual.information / weight)


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
    covariance, still = half_known(3)
    for number in range(80):
        rest = random_states(1e-4 * START, 3, number)
        rest = States(rest.t + 0.05 * number, rest.T_world_cam, rest.twist)
        noise.learn(rest, noise.qc[0] / START[0] * covariance, still)
    before = noise.qc
    jerk = random_states(1e3 * START, 3, 99)
    jerk = States(jerk.t + 4.0, jerk.T_world_cam, jerk.twist)
    noise.learn(jerk, noise.qc[0] / START[0] * covariance, still)
    assert (before <= 0.15 * START).all() and (noise.qc > 10 * START).all()


def test_noise_is_learned_by_default_and_not_in_the_papers_way() -> None:
    automatic, paper = (
        Configuration().noise,
        Configuration.model_validate({"preset": "paper"}).noise,
    )
    assert automatic.motion_memory > 0 and automatic.measurement_memory > 0
    assert paper.motion_memory == 0 and paper.measurement_memory == 0
