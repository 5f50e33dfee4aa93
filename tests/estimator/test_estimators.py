"""Both estimators: exact where theory says so, honest where there is nothing to see."""

from __future__ import annotations

import numpy as np
import pytest
from runs import (
    METHODS,
    NOTHING,
    PERIOD,
    POINTS,
    deviation,
    difference,
    errors,
    estimate,
    fed,
    make,
    regular,
)
from synthetic import TWIST, constant_velocity, tracklets

from factors import wnoa_information
from factors.lie import se3_inverse, se3_log
from gpvo.config import NoiseConfig
from gpvo.tracking import Measurements


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.01])
def test_constant_velocity_without_noise_is_recovered(method: str, interval: float) -> None:
    trajectory = estimate(
        tracklets(), method=method, state_interval=interval, relative_decrease=1e-9
    )
    # The prior on the first velocity, 1 (m/s) around zero, is all that pulls away from the truth.
    assert np.abs(errors(trajectory)).max() < 2e-3
    assert np.abs(trajectory.velocity(trajectory.t) - TWIST).max() < 2e-2


@pytest.mark.parametrize("method", METHODS)
def test_weak_velocity_prior_leaves_the_exact_motion(method: str) -> None:
    noise = NoiseConfig(initial_velocity=1e4)
    trajectory = estimate(tracklets(), noise, method=method, relative_decrease=1e-12)
    assert np.abs(errors(trajectory)).max() < 1e-6


@pytest.mark.parametrize("share", [0.01, 1e-4])
def test_gauss_newton_ends_by_the_share_of_the_cost_not_by_its_size(share: float) -> None:
    """All variances times a number have the same optimum, and the same steps to it."""
    seen, many = tracklets(noise=0.5), 1e6
    noise = NoiseConfig(measurement_information=(0.5, 0.5, 0.1))
    vague = NoiseConfig(
        acceleration_psd=tuple(many * value for value in noise.acceleration_psd),
        measurement_information=tuple(value / many for value in noise.measurement_information),
        initial_velocity=np.sqrt(many) * noise.initial_velocity,
    )
    found, same = (
        estimate(seen, one, method="batch", relative_decrease=share) for one in (noise, vague)
    )
    np.testing.assert_allclose(same.T_world_cam, found.T_world_cam, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_every_unique_time_is_a_state(method: str) -> None:
    measurements = tracklets()
    t = np.unique(np.concatenate([part.t for part in measurements]))
    trajectory = estimate(measurements, method=method)
    assert np.isin(t, trajectory.t).all()


@pytest.mark.parametrize("method", METHODS)
def test_states_in_the_window_are_those_at_unique_times(method: str) -> None:
    """Of landmarks that are measured twice, once the window has moved on."""
    estimator, parts = make(method=method, window=4, settling=0.0), tracklets(clusters=9)
    estimator.update(PERIOD, NOTHING)
    assert len(estimator.states) == 0
    for number, part in enumerate(parts):
        estimator.update((number + 1) * PERIOD, part)
        states = estimator.states
        known = Measurements.concatenate(parts[: number + 1])
        landmark, count = np.unique(known.landmark, return_counts=True)
        twice = known[np.isin(known.landmark, landmark[count >= 2])]
        inside = np.unique(twice.t[twice.t > states.t[0]])
        assert np.isin(inside, states.t).all()
        if number >= 4:
            assert len(inside) >= 3 * len(part) - 7
    trajectory = estimator.trajectory()
    assert trajectory is not None and len(states) < len(trajectory)
    assert np.array_equal(states.t, trajectory.t[-len(states) :])
    assert np.array_equal(states.T_world_cam, trajectory.T_world_cam[-len(states) :])
    assert np.array_equal(states.twist, trajectory.twist[-len(states) :])


def test_methods_agree_on_noisy_tracklets_while_nothing_has_left_the_window() -> None:
    """The batch window's prior on the first velocity moves with it, so it is weak here."""
    measurements, noise = tracklets(noise=0.3), NoiseConfig(initial_velocity=1e3)
    batch = estimate(measurements, noise, method="batch", window=10, relative_decrease=1e-9)
    incremental = estimate(measurements, noise, window=10)
    t = batch.t[1:]
    sigma = np.sqrt(np.diagonal(incremental.covariance(t), 0, 1, 2))
    # One step of Gauss-Newton a cluster against many: a few hundredths of a standard deviation.
    assert (np.abs(difference(incremental, batch, t)) / sigma).max() < 0.05
    # The batch covariance comes from states 20 ms apart with interpolated measurements.
    variances = (np.diagonal(x.covariance(batch.stop)) for x in (batch, incremental))
    assert np.allclose(*variances, rtol=0.1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("window", [3, 5])
def test_prior_carries_on_through_clusters_without_tracklets(method: str, window: int) -> None:
    parts = tracklets(clusters=8)
    seen = [*parts[:5], NOTHING, NOTHING, NOTHING]
    trajectory = estimate(seen, method=method, window=window)
    last = max(part.t.max() for part in parts[:5])
    assert trajectory.stop == pytest.approx(8 * PERIOD)
    ahead = trajectory.pose(last) @ constant_velocity(
        np.array([trajectory.stop - last]), trajectory.velocity(last)
    )
    assert np.allclose(trajectory.pose(trajectory.stop), ahead, atol=1e-6)
    spread = np.diagonal(trajectory.covariance(np.array([last, 0.35, trajectory.stop])), 0, 1, 2)
    assert (np.diff(spread, axis=0) > 0).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.1])
def test_tracklets_that_come_back_after_a_gap_go_on_with_the_trajectory(
    method: str, interval: float
) -> None:
    parts = tracklets(clusters=14)
    seen = [part if not 5 <= number < 9 else NOTHING for number, part in enumerate(parts)]
    trajectory = estimate(seen, method=method, window=3, state_interval=interval)
    assert np.isfinite(trajectory.T_world_cam).all()
    assert np.abs(errors(trajectory)).max() < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_nothing_ever_seen_is_no_trajectory(method: str) -> None:
    estimator = make(method=method)
    estimator.update(PERIOD, NOTHING)
    assert estimator.trajectory() is None


@pytest.mark.parametrize("method", METHODS)
def test_times_a_microsecond_apart_are_states_of_their_own(method: str) -> None:
    parts = tracklets(clusters=4)
    twin = parts[2]
    parts[2] = Measurements.concatenate(
        [twin, Measurements(twin.landmark, twin.frame, twin.t + 1e-6, twin.stereo)]
    )
    trajectory = estimate(parts, method=method)
    assert (np.diff(trajectory.t) < 1.5e-6).sum() >= len(twin)
    assert np.isfinite(trajectory.T_world_cam).all()


@pytest.mark.parametrize("clusters", [3, 40])
@pytest.mark.parametrize("interval", [0.0, 0.1])
def test_covariance_of_the_prior_alone_is_the_wnoa_covariance(
    clusters: int, interval: float
) -> None:
    """From a state that is known, the twist's variance grows by Q_c dt, for seconds."""
    seen = [*tracklets(clusters=5), *[NOTHING] * clusters]
    trajectory = estimate(seen, state_interval=interval)
    start, stop = 5 * PERIOD, (5 + clusters) * PERIOD
    grown = trajectory.covariance(stop)[6:, 6:] - trajectory.covariance(start)[6:, 6:]
    information = wnoa_information(stop - start, NoiseConfig().acceleration_psd)
    expected = np.linalg.inv(information)[6:, 6:]
    scale = np.sqrt(np.diag(expected))
    # The next order turns the noise by half the rotation and translation on the way.
    tolerance = np.abs(TWIST).max() * (stop - start) / 2
    assert np.abs((grown - expected) / np.outer(scale, scale)).max() < tolerance


def test_key_times_differ_from_unique_times_by_less_than_a_percent_of_three_sigma() -> None:
    """As they do in a batch: what measurements know of the deviations between is left out."""
    measurements = tracklets(clusters=10, per_cluster=15, noise=1.0)
    unique, key = (estimate(measurements, state_interval=x) for x in (0.0, 0.025))
    t = np.linspace(unique.start + 0.01, unique.stop, 200)
    sigma = np.sqrt(np.diagonal(unique.covariance(t), 0, 1, 2)[:, :6])
    assert (np.abs(difference(key, unique, t)[:, :6]) / (3 * sigma)).max() < 0.01


def test_estimators_agree_after_measurements_have_left_the_window() -> None:
    """Unique and key times within a few hundredths of a standard deviation.

    The batch window forgets what it measured: it differs within three of its own deviations.
    """
    measurements = tracklets(clusters=9, noise=0.3)
    reference = estimate(measurements, POINTS)
    start = 5.5 * PERIOD
    for method, interval, tolerance in [
        ("fixed_lag", 0.025, 0.05),
        ("fixed_lag", 0.1, 0.1),
        ("batch", 0.0, 3.0),
        ("batch", 0.025, 3.0),
    ]:
        other = estimate(measurements, POINTS, method=method, state_interval=interval)
        assert deviation(reference, other, start).max() < tolerance, (method, interval)


@pytest.mark.parametrize("interval", [0.0, 0.025])
def test_final_states_join_those_of_the_window_without_jumps(interval: float) -> None:
    """What a step has beyond the mean twist is no larger over borders of the window than inside."""
    trajectory = estimate(
        tracklets(clusters=14, per_cluster=10, noise=1.0), window=4, state_interval=interval
    )
    t = np.arange(trajectory.start, trajectory.stop, 0.0125)
    T, v = trajectory.pose(t), trajectory.velocity(t)
    step = se3_log(se3_inverse(T[:-1]) @ T[1:])
    jump = np.abs(step - 0.5 * np.diff(t)[:, None] * (v[:-1] + v[1:])).max(axis=1)
    border = np.min(np.abs(t[:-1, None] - PERIOD * np.arange(15)), axis=1) < 0.0125
    assert jump[border].max() < 1.1 * jump[~border].max()
    assert np.abs(np.diff(v, axis=0)).max() < 0.1


@pytest.mark.parametrize("method", METHODS)
def test_columns_that_do_not_fit_are_a_clear_error_and_it_goes_on(method: str) -> None:
    clusters = regular(tracklets(clusters=6, noise=0.3))
    estimator, plain = make(method=method, window=3), make(method=method, window=3)
    for number, (end_time, part) in enumerate(clusters):
        unfit = [
            {"landmark": part.landmark[:-1]},
            {"landmark": part.landmark.astype(float)},
            {"t": part.t[:-1]},
            {"stereo": part.stereo[:, :2]},
        ]
        for columns in unfit if number in (0, 4) else []:
            with pytest.raises(ValueError, match=r"measurements\.(landmark|stereo)"):
                estimator.update(end_time, Measurements(**vars(part) | columns))
        estimator.update(end_time, part)
    ours, theirs = estimator.trajectory(), fed(plain, clusters)
    assert ours is not None
    assert np.array_equal(ours.T_world_cam, theirs.T_world_cam)
    assert not estimator.diagnostics
