"""Where the estimator starts: the velocity that MC-RANSAC measured, weighed against the prior's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.config.stages import NoiseConfig
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
ESTIMATED_VELOCITY = 1e-4
"""Variance of an estimated velocity, (rad/s)^2 and (m/s)^2, before the prior lets it drift."""
FIXED = 1e-6
"""Standard deviation of the pose that the world or a window starts with, rad and m."""


def start_deviations(noise: NoiseConfig) -> Array:
    """(12,) of the first state: its pose is fixed, its twist what the prior allows."""
    return np.repeat([FIXED, noise.initial_velocity], 6)


def start_states(t: float, fit: VelocityFit | None, noise: NoiseConfig) -> States:
    """The first state: the world's origin, at time t."""
    twist = fused_velocity(np.zeros(6), noise.initial_velocity**2 * np.eye(6), fit)
    return States(np.array([t]), np.eye(4)[None], twist[None])


def velocity_ahead(states: States, t: float, fit: VelocityFit | None, noise: NoiseConfig) -> Array:
    """Body twist (6,) from the last state on to time t.

    One pair of clusters confuses translation with rotation; what the prior knows of the earlier
    velocity settles it, so that wild fits of thin clusters do no harm.
    """
    drift = max(t - states.t[-1], 0.0) * np.diag(noise.acceleration_psd)
    return fused_velocity(states.twist[-1], drift + ESTIMATED_VELOCITY * np.eye(6), fit)


def fused_velocity(predicted: Array, covariance: Array, fit: VelocityFit | None) -> Array:
    """Predicted twist (6,), with its covariance (6, 6), corrected by the measured one."""
    if fit is None:
        return predicted
    gain = covariance @ np.linalg.inv(covariance + fit.covariance)
    return predicted + gain @ (fit.velocity - predicted)
