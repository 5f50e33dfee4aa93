"""The lag, in clusters or in seconds; and factors of others in GTSAM's smoother."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X
from synthetic import CAMERA, tracklets
from test_estimators import METHODS, PERIOD, estimate

from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.state_times import Lag


@pytest.mark.parametrize("method", METHODS)
def test_a_lag_in_seconds_is_that_of_as_many_clusters(method: str) -> None:
    """A cluster's end counts: four clusters end within three periods."""
    measurements = tracklets(clusters=8, per_cluster=5, noise=0.3)
    clusters = estimate(measurements, method=method, window=4, state_interval=0.025)
    seconds = estimate(measurements, method=method, lag=3 * PERIOD, state_interval=0.025)
    assert np.array_equal(clusters.t, seconds.t)
    assert np.allclose(clusters.T_world_cam, seconds.T_world_cam, atol=1e-9)
    assert np.allclose(clusters.knot_covariance, seconds.knot_covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_lag_shorter_than_a_cluster_goes_on(method: str) -> None:
    trajectory = estimate(tracklets(clusters=6), method=method, lag=1e-3, state_interval=0.025)
    assert np.isfinite(trajectory.T_world_cam).all()
    assert trajectory.stop > 5 * PERIOD


def test_the_window_starts_once_it_is_full() -> None:
    lag = Lag(EstimatorConfig(window=3))
    starts = []
    for stop in (0.1, 0.2, 0.2, 0.15, 0.4):
        lag.advance(stop)
        starts.append(lag.start)
    assert starts == [-np.inf, -np.inf, 0.1, 0.2, 0.2]
    assert lag.stop == 0.4


def smoother_with(
    factor: gtsam.NonlinearFactor | None, clusters: int = 9, added: int = 3
) -> FixedLagSmoother:
    """A smoother that got a factor of the newest state's after some clusters."""
    config = EstimatorConfig(window=3, state_interval=0.025)
    smoother = FixedLagSmoother(CAMERA, NoiseConfig(), config)
    for frame, part in enumerate(tracklets(clusters=clusters, noise=0.3)):
        smoother.update(frame, (frame + 1) * PERIOD, part, None)
        if frame == added and factor is not None:
            smoother.add(factor)
    return smoother


def test_a_factor_of_others_counts_while_in_the_window_and_after() -> None:
    plain = smoother_with(None, clusters=4)
    newest, t = plain.window[-1], plain.window_times[-1]
    trajectory = plain.trajectory(0)
    assert trajectory is not None
    aside = trajectory.pose(t)[:3, 3] + [0.05, 0.0, 0.0]
    gps = gtsam.GPSFactor(X(newest), aside, gtsam.noiseModel.Isotropic.Sigma(3, 1e-4))
    for clusters in (5, 9):
        found = smoother_with(gps, clusters).trajectory(0)
        assert found is not None
        assert np.abs(found.pose(t)[:3, 3] - aside).max() < 2e-3
    assert not smoother_with(gps).repairs


def test_a_factor_of_others_that_fails_is_left_out_and_told() -> None:
    def error(*_: object) -> np.ndarray:
        raise ValueError("no measurement")

    model = gtsam.noiseModel.Unit.Create(1)
    newest = smoother_with(None, clusters=4).window[-1]
    smoother = smoother_with(gtsam.CustomFactor(model, [X(newest)], error))
    plain = smoother_with(None)
    assert [repair.reason for repair in smoother.repairs if "others" in repair.reason]
    ours, theirs = smoother.trajectory(0), plain.trajectory(0)
    assert ours is not None and theirs is not None
    assert np.abs(ours.pose(ours.stop) - theirs.pose(theirs.stop)).max() < 0.02


def test_a_factor_of_a_state_that_is_not_there_is_left_out_and_told() -> None:
    unit = gtsam.noiseModel.Unit.Create(6)
    smoother = smoother_with(gtsam.PriorFactorVector(V(999), np.zeros(6), unit))
    told = [repair for repair in smoother.repairs if "others" in repair.reason]
    assert [repair.key for repair in told] == ["v999"] and len(smoother.repairs) == 1
    ours, theirs = smoother.trajectory(0), smoother_with(None).trajectory(0)
    assert ours is not None and theirs is not None
    assert np.array_equal(ours.T_world_cam, theirs.T_world_cam)
