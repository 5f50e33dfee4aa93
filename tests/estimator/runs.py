"""Estimators that are fed with synthetic tracklets, and how their trajectories compare."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from synthetic import CAMERA, TWIST, constant_velocity

from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import Estimator, make_estimator, one_blas_thread
from gpvo.mc_ransac import VelocityFit
from gpvo.tracking import Measurements
from gpvo.trajectory import States, Trajectory

Cluster = tuple[float, Measurements]
METHODS = ("fixed_lag", "batch")
PERIOD = 0.05
NOTHING = Measurements.concatenate([])
POINTS = NoiseConfig(track_drift=0.0)
"""Noise of landmarks that are points, as theory has them."""


def regular(parts: Iterable[Measurements]) -> list[Cluster]:
    """Parts as clusters of one period each."""
    return [((number + 1) * PERIOD, part) for number, part in enumerate(parts)]


def make(noise: NoiseConfig | None = None, **settings: object) -> Estimator:
    """Estimator with these settings."""
    config = EstimatorConfig.model_validate(settings)
    return make_estimator(CAMERA, noise or NoiseConfig(), config)


def fed(
    estimator: Estimator, clusters: Iterable[Cluster], fit: VelocityFit | None = None
) -> Trajectory:
    """Trajectory of an estimator after some clusters, with one BLAS thread as in `Odometry`."""
    with one_blas_thread():
        for end_time, measurements in clusters:
            estimator.update(end_time, measurements, fit)
        trajectory = estimator.trajectory()
    assert trajectory is not None
    return trajectory


def estimate(
    parts: Iterable[Measurements], noise: NoiseConfig | None = None, **settings: object
) -> Trajectory:
    """Trajectory of clusters of one period each."""
    return fed(make(noise, **settings), regular(parts))


def errors(trajectory: Trajectory, twist: np.ndarray = TWIST) -> np.ndarray:
    """(N, 6) errors of the poses at the states, against a motion at constant velocity."""
    truth = constant_velocity(trajectory.t, twist)
    return se3_log(se3_inverse(se3_inverse(truth[0]) @ truth) @ trajectory.T_world_cam)


def difference(trajectory: Trajectory, reference: Trajectory, t: np.ndarray) -> np.ndarray:
    """(N, 12) difference of pose and velocity at times t (N,)."""
    pose = se3_log(se3_inverse(reference.pose(t)) @ trajectory.pose(t))
    return np.hstack([pose, trajectory.velocity(t) - reference.velocity(t)])


def deviation(
    trajectory: Trajectory, reference: Trajectory, start: float | None = None
) -> np.ndarray:
    """(N, 12) difference from `start` to both ends, in the reference's standard deviations."""
    stop = min(reference.stop, trajectory.stop)
    t = np.linspace(reference.start if start is None else start, stop, 100)[1:]
    sigma = np.sqrt(np.diagonal(reference.covariance(t), 0, 1, 2))
    return np.abs(difference(trajectory, reference, t)) / sigma


def states_of(trajectory: Trajectory) -> States:
    """States of a trajectory."""
    return States(trajectory.t, trajectory.T_world_cam, trajectory.twist)
