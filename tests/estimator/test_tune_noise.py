"""Noise parameters are learned back from data that was simulated with them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.simulated_tracklets import TrackletSimulation
from gpvo.config import NoiseConfig
from gpvo.config.stages.estimator import LEAST_NOISE
from gpvo.errors import InputError
from gpvo.estimator.noise_learning import (
    acceleration_psd,
    measurement_information,
    states_of_poses,
    tuned_noise,
)
from gpvo.tracking import Measurements
from gpvo.trajectory import States

TRUE = NoiseConfig(
    acceleration_psd=(0.002, 0.004, 0.001, 0.02, 0.04, 0.01),
    measurement_information=(4.0, 2.0, 1.0),
    initial_velocity=0.3,
)


def test_noise_is_learned_back() -> None:
    rng, simulation = np.random.default_rng(0), TrackletSimulation(TRUE, per_cluster=20)
    motion = simulation.motion(4.0, rng)
    clusters = [measurements for _, measurements in simulation.clusters(motion, rng)]
    learned = tuned_noise(clusters, motion, simulation.camera)
    # 800 steps tell a variance to 5 % (one sigma).
    assert np.allclose(learned.acceleration_psd, TRUE.acceleration_psd, rtol=0.2)
    assert np.allclose(learned.measurement_information, TRUE.measurement_information, rtol=0.1)


def test_outliers_hardly_change_the_measurement_noise() -> None:
    rng, simulation = np.random.default_rng(1), TrackletSimulation(TRUE, per_cluster=20)
    motion = simulation.motion(1.0, rng)
    clean = Measurements.concatenate([part for _, part in simulation.clusters(motion, rng)])
    stereo = clean.stereo.copy()
    wrong = rng.random(len(stereo)) < 0.05
    stereo[wrong] += rng.uniform(-40, 40, (wrong.sum(), 3)) * [1, 1, 0.1]
    dirty = Measurements(clean.landmark, clean.frame, clean.t, stereo)
    expected = measurement_information(clean, motion, simulation.camera)
    assert np.allclose(
        measurement_information(dirty, motion, simulation.camera), expected, rtol=0.4
    )


def test_a_motion_without_acceleration_still_gives_a_configuration() -> None:
    rng, simulation = np.random.default_rng(3), TrackletSimulation(TRUE, per_cluster=20)
    moving = simulation.motion(1.0, rng)
    still = States(moving.t, np.tile(np.eye(4), (len(moving.t), 1, 1)), 0 * moving.twist)
    clusters = [measurements for _, measurements in simulation.clusters(still, rng)]
    assert tuned_noise(clusters, still, simulation.camera).acceleration_psd == (LEAST_NOISE,) * 6


def test_true_poses_become_states_with_their_velocity() -> None:
    motion = TrackletSimulation(TRUE).motion(0.5, np.random.default_rng(2))
    states = states_of_poses(motion.t, motion.T_world_cam)
    assert np.abs(states.twist - motion.twist).max() < 0.05


def test_too_little_data_is_one_clear_error() -> None:
    with pytest.raises(InputError, match="three or more"):
        acceleration_psd(np.zeros(2), np.tile(np.eye(4), (2, 1, 1)))
    nothing, still = Measurements.concatenate([]), np.tile(np.eye(4), (3, 1, 1))
    motion = States(np.arange(3.0), still, np.zeros((3, 6)))
    with pytest.raises(InputError, match="three times"):
        measurement_information(nothing, motion, TrackletSimulation(TRUE).camera)
