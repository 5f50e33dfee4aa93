"""A loop that is driven twice: landmarks that were behind the camera are known when they return."""

from __future__ import annotations

from functools import cache

import numpy as np
from runs import errors, fed
from synthetic import CAMERA, constant_velocity

from factors.lie import se3_inverse
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.tracking import Measurements
from gpvo.trajectory import Trajectory

ROUND = 40
"""Clusters of a round."""
PERIOD = 0.05
TWIST = np.array([0.0, 2 * np.pi / (ROUND * PERIOD), 0.0, 0.0, 0.0, 1.5])
"""Ahead and to the right, all around a point."""
NOISE = NoiseConfig(track_drift=0.0)
PER_CLUSTER = 6
"""New landmarks of a cluster, in the first round; each is seen for a quarter of a round at most."""


def landmarks(rng: np.random.Generator) -> np.ndarray:
    """Points (L, 3) in the world, each in view from one of the poses of the first round."""
    T = np.repeat(constant_velocity(PERIOD * np.arange(ROUND), TWIST), PER_CLUSTER, axis=0)
    stereo = rng.uniform([20, 40, 5], [320, 220, 12], (len(T), 3))
    local = CAMERA.triangulate(stereo)
    return np.einsum("nij,nj->ni", T[:, :3, :3], local) + T[:, :3, 3]


def two_rounds(seed: int) -> list[tuple[float, Measurements]]:
    """What is measured of a quarter of all landmarks in view, with the noise of `NOISE`."""
    rng = np.random.default_rng(seed)
    world, sigma = landmarks(rng), 1 / np.sqrt(NOISE.measurement_information)
    clusters = []
    for cluster in range(2 * ROUND):
        t = np.round((cluster + rng.random(len(world))) * PERIOD, 6)
        T_cam_world = se3_inverse(constant_velocity(t, TWIST))
        local = np.einsum("nij,nj->ni", T_cam_world[:, :3, :3], world) + T_cam_world[:, :3, 3]
        ahead = local[:, 2] > 0.5
        local[~ahead] = [0.0, 0.0, 1.0]
        measured = CAMERA.project(local) + sigma * rng.standard_normal(local.shape)
        inside = (measured[:, :2] > 0).all(1) & (measured[:, :2] < [346, 260]).all(1)
        seen = np.flatnonzero(ahead & inside & (measured[:, 2] > 2))
        number = np.full(len(seen), cluster)
        stereo = Measurements(seen, number, t[seen], measured[seen])
        clusters.append(((cluster + 1) * PERIOD, stereo))
    return clusters


@cache
def driven(seed: int, lost_landmarks: int) -> tuple[FixedLagSmoother, Trajectory]:
    config = EstimatorConfig(lost_landmarks=lost_landmarks)
    smoother = FixedLagSmoother(CAMERA, NOISE, config)
    return smoother, fed(smoother, two_rounds(seed))


def test_the_second_round_is_as_good_as_the_first() -> None:
    """Without memory it drifts on; the covariance knows which it is."""
    second, nees = {0: [], 300: []}, []
    for seed in range(3):
        for lost_landmarks, found in second.items():
            smoother, trajectory = driven(seed, lost_landmarks)
            assert not smoother.diagnostics
            error = errors(trajectory, TWIST)
            found.append(error[trajectory.t > ROUND * PERIOD, 3:])
        last = error[-1]
        covariance = trajectory.covariance(trajectory.t[-1])[:6, :6]
        nees.append(last @ np.linalg.solve(covariance, last) / 6)
    known, unknown = (np.sqrt(np.mean(np.concatenate(second[n]) ** 2)) for n in (300, 0))
    assert known < 0.5 * unknown
    assert np.mean(nees) < 1.6  # the 95 % bound for 18 degrees of freedom


def test_a_few_that_are_remembered_close_the_loop() -> None:
    """A quarter of all, however many were lost between."""
    smoother, trajectory = driven(0, PER_CLUSTER * ROUND // 4)
    in_view = {number for _, seen in two_rounds(0)[-7:] for number in seen.landmark.tolist()}
    assert len(set(smoother.landmarks[0]) - in_view) <= PER_CLUSTER * ROUND // 4
    forgetful = driven(0, 0)[1]
    t = trajectory.t[trajectory.t > ROUND * PERIOD]
    known, unknown = (
        np.linalg.norm(errors(each, TWIST)[-len(t) :, 3:], axis=1).mean()
        for each in (trajectory, forgetful)
    )
    assert known < 0.6 * unknown
