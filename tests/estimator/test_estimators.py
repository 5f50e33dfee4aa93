"""Both estimators: exact where theory says so, honest where there is nothing to see."""

from __future__ import annotations

import numpy as np
import pytest
from gpvo.estimator.gauss_newton_smoother import GaussNewtonSmoother
from synthetic import CAMERA, TWIST, constant_velocity, tracklets

from factors import wnoa_information
from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.batch_window import SlidingWindow
from gpvo.tracking import Measurements
from gpvo.trajectory import Trajectory

PERIOD = 0.05
METHODS = {
    "batch": SlidingWindow,
    "fixed_lag": FixedLagSmoother,
    "gauss_newton": GaussNewtonSmoother,
}
NOTHING = Measurements.concatenate([])


def estimate(
    measurements: list[Measurements], noise: NoiseConfig | None = None, **settings: object
) -> Trajectory:
    config = EstimatorConfig(**settings)  # type: ignore[arg-type]
    estimator = METHODS[config.method](CAMERA, noise or NoiseConfig(), config)
    for frame, new in enumerate(measurements):
        estimator.update(frame, (frame + 1) * PERIOD, new, None)
    trajectory = estimator.trajectory(0)
    assert trajectory is not None
    return trajectory


def relative_to_first(trajectory: Trajectory) -> np.ndarray:
    truth = constant_velocity(trajectory.t)
    truth = se3_inverse(truth[0]) @ truth
    return se3_log(se3_inverse(truth) @ trajectory.T_world_cam)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.01])
def test_constant_velocity_without_noise_is_recovered(method: str, interval: float) -> None:
    trajectory = estimate(
        tracklets(), method=method, state_interval=interval, relative_decrease=1e-9
    )
    # The prior on the first velocity, 1 (m/s) around zero, is all that pulls away from the truth.
    assert np.abs(relative_to_first(trajectory)).max() < 2e-3
    assert np.abs(trajectory.velocity(trajectory.t) - TWIST).max() < 2e-2


@pytest.mark.parametrize("method", METHODS)
def test_weak_velocity_prior_leaves_the_exact_motion(method: str) -> None:
    noise = NoiseConfig(initial_velocity=1e4)
    trajectory = estimate(tracklets(), noise, method=method, relative_decrease=1e-12)
    assert np.abs(relative_to_first(trajectory)).max() < 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_every_unique_time_is_a_state(method: str) -> None:
    measurements = tracklets()
    t = np.unique(np.concatenate([part.t for part in measurements]))
    trajectory = estimate(measurements, method=method, state_interval=0)
    assert np.isin(t, trajectory.t).all()


def test_methods_agree_on_noisy_tracklets_while_nothing_has_left_the_window() -> None:
    measurements = tracklets(noise=0.3)
    settings = {"window": 10, "state_interval": 0}
    batch = estimate(measurements, method="batch", relative_decrease=1e-9, **settings)
    incremental = estimate(measurements, method="fixed_lag", **settings)
    assert np.array_equal(batch.t, incremental.t)
    difference = se3_log(se3_inverse(batch.T_world_cam) @ incremental.T_world_cam)
    difference = np.hstack([difference, batch.twist - incremental.twist])
    variance = np.diagonal(incremental.covariance(incremental.t), 0, 1, 2)
    # One step of Gauss-Newton a cluster against many: a few hundredths of a standard deviation.
    assert (np.abs(difference[1:]) / np.sqrt(variance[1:])).max() < 0.05
    # The batch covariance comes from states 20 ms apart with interpolated measurements.
    assert np.allclose(np.diagonal(batch.covariance(batch.stop)), variance[-1], rtol=0.1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("window", [3, 5])
def test_prior_carries_on_through_clusters_without_tracklets(method: str, window: int) -> None:
    parts = tracklets(clusters=8)
    seen = [*parts[:5], NOTHING, NOTHING, NOTHING]
    trajectory = estimate(seen, method=method, window=window, state_interval=0)
    last = max(part.t.max() for part in parts[:5])
    assert trajectory.stop == pytest.approx(8 * PERIOD)
    ahead = trajectory.pose(last) @ constant_velocity(
        np.array([trajectory.stop - last]), trajectory.velocity(last)
    )
    assert np.allclose(trajectory.pose(trajectory.stop), ahead, atol=1e-6)
    spread = np.diagonal(trajectory.covariance(np.array([last, 0.35, trajectory.stop])), 0, 1, 2)
    assert (np.diff(spread, axis=0) > 0).all()


@pytest.mark.parametrize("method", METHODS)
def test_tracklets_that_come_back_after_a_gap_go_on_with_the_trajectory(method: str) -> None:
    parts = tracklets(clusters=14)
    seen = [part if not 5 <= frame < 9 else NOTHING for frame, part in enumerate(parts)]
    trajectory = estimate(seen, method=method, window=3, state_interval=0)
    assert np.isfinite(trajectory.T_world_cam).all()
    assert np.abs(relative_to_first(trajectory)).max() < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_nothing_ever_seen_is_no_trajectory(method: str) -> None:
    estimator = METHODS[method](CAMERA, NoiseConfig(), EstimatorConfig())
    estimator.update(0, PERIOD, NOTHING, None)
    assert estimator.trajectory(0) is None


def test_times_a_microsecond_apart_are_states_of_their_own() -> None:
    parts = tracklets(clusters=4)
    twin = parts[2]
    parts[2] = Measurements.concatenate(
        [twin, Measurements(twin.landmark, twin.frame, twin.t + 1e-6, twin.stereo)]
    )
    for method in ("batch", "fixed_lag"):
        trajectory = estimate(parts, method=method, state_interval=0)
        assert (np.diff(trajectory.t) < 1.5e-6).sum() >= len(twin)
        assert np.isfinite(trajectory.T_world_cam).all()


@pytest.mark.parametrize("method", ["fixed_lag", "gauss_newton"])
@pytest.mark.parametrize("clusters", [3, 40])
def test_covariance_of_the_prior_alone_is_the_wnoa_covariance(method: str, clusters: int) -> None:
    """From a state that is known, the twist's variance grows by Q_c dt, for seconds."""
    seen = [*tracklets(clusters=5), *[NOTHING] * clusters]
    trajectory = estimate(seen, method=method)
    start, stop = 5 * PERIOD, (5 + clusters) * PERIOD
    grown = trajectory.covariance(stop)[6:, 6:] - trajectory.covariance(start)[6:, 6:]
    information = wnoa_information(stop - start, NoiseConfig().acceleration_psd)
    expected = np.linalg.inv(information)[6:, 6:]
    scale = np.sqrt(np.diag(expected))
    # The next order turns the noise by half the rotation and translation on the way.
    tolerance = np.abs(TWIST).max() * (stop - start) / 2
    assert np.abs((grown - expected) / np.outer(scale, scale)).max() < tolerance
