"""The lag, in clusters or in seconds."""

from __future__ import annotations

import numpy as np
import pytest
from runs import METHODS, PERIOD, estimate
from synthetic import tracklets

from gpvo.config import EstimatorConfig
from gpvo.estimator.state_times import Lag


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.025])
def test_a_lag_in_seconds_is_that_of_as_many_clusters(method: str, interval: float) -> None:
    """A cluster's end counts: four clusters end within three periods."""
    measurements = tracklets(clusters=8, per_cluster=5, noise=0.3)
    settings = {"method": method, "state_interval": interval}
    clusters = estimate(measurements, window=4, **settings)
    seconds = estimate(measurements, lag=3 * PERIOD, **settings)
    assert np.array_equal(clusters.t, seconds.t)
    assert np.allclose(clusters.T_world_cam, seconds.T_world_cam, atol=1e-9)
    assert np.allclose(clusters.knot_covariance, seconds.knot_covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.025])
def test_a_lag_shorter_than_a_cluster_goes_on(method: str, interval: float) -> None:
    trajectory = estimate(tracklets(clusters=6), method=method, lag=1e-3, state_interval=interval)
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
