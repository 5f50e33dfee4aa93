"""Where the estimator starts: the velocity that MC-RANSAC measured, weighed against the prior's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.checks import checked_pose, checked_vector
from gpvo.config.stages import NoiseConfig
from gpvo.mc_ransac import VelocityFit, fused_velocity
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
ESTIMATED_VELOCITY = 1e-4
"""Variance of an estimated velocity, (rad/s)^2 and (m/s)^2, before the prior lets it drift."""
FIXED = 1e-6
"""Standard deviation of the pose that the world or a window starts with, rad and m."""


@dataclass(frozen=True, eq=False)
class InitialState:
    """What is known of the state at the first measurement, in a world of your own, such as ENU.

    Attributes
    ----------
    T_world_cam
        (4, 4) pose of the rectified left camera, or gtsam.Pose3.
    twist
        (6,) body velocity, rotation first, rad/s and m/s.
    covariance
        (12, 12) of both, the pose perturbed on the right; pose and twist are taken as independent.

    Raises
    ------
    ValueError
        If one has another shape, the pose is none, or the covariance is not positive definite.
    """

    T_world_cam: Array
    twist: Array
    covariance: Array

    def __post_init__(self) -> None:
        pose, covariance = checked_pose("T_world_cam", self.T_world_cam), np.array(self.covariance)
        if covariance.shape != (12, 12) or not np.isfinite(covariance).all():
            raise ValueError(f"covariance must be (12, 12) finite numbers, not {covariance.shape}")
        if not (np.allclose(covariance, covariance.T) and np.linalg.eigvalsh(covariance)[0] > 0):
            raise ValueError("covariance must be symmetric and positive definite")
        twist = checked_vector("twist", self.twist, 6)
        for name, value in (("T_world_cam", pose), ("twist", twist), ("covariance", covariance)):
            object.__setattr__(self, name, value)

    @staticmethod
    def at_origin(noise: NoiseConfig) -> InitialState:
        """The world is the first pose; the twist is what the prior allows."""
        return InitialState(np.eye(4), np.zeros(6), np.diag(start_deviations(noise) ** 2))


def start_deviations(noise: NoiseConfig) -> Array:
    """(12,) of the first state: its pose is fixed, its twist what the prior allows."""
    return np.repeat([FIXED, noise.initial_velocity], 6)


def start_states(t: float, fit: VelocityFit | None, initial: InitialState) -> States:
    """The first state, at time t."""
    twist = fused_velocity(initial.twist, initial.covariance[6:, 6:], fit)
    return States(np.array([t]), initial.T_world_cam[None], twist[None])


def velocity_ahead(states: States, t: float, fit: VelocityFit | None, noise: NoiseConfig) -> Array:
    """Body twist (6,) from the last state on to time t.

    One pair of clusters confuses translation with rotation; what the prior knows of the earlier
    velocity settles it, so that wild fits of thin clusters do no harm.
    """
    drift = max(t - states.t[-1], 0.0) * np.diag(noise.acceleration_psd)
    return fused_velocity(states.twist[-1], drift + ESTIMATED_VELOCITY * np.eye(6), fit)
