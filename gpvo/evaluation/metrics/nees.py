"""Consistency of covariances: the normalized estimation error squared (NEES).

Source: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation",
section 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from factors.lie import se3_inverse, se3_log
from gpvo.trajectory import States, Trajectory

Array = NDArray[np.float64]


def nees(trajectory: Trajectory, truth: States, t: Array) -> tuple[Array, Array]:
    """Compute the NEES (N,) of pose and velocity at times t (N,); 6 on average if consistent.

    The true motion is taken relative to its pose at the trajectory's start.
    """
    T_true, twist_true = truth.query(t)
    start, _ = truth.query(np.array([trajectory.start]))
    pose = se3_log(se3_inverse(trajectory.pose(t)) @ se3_inverse(start) @ T_true)
    velocity = twist_true - trajectory.velocity(t)
    covariance = trajectory.covariance(t)
    return _squared(pose, covariance[:, :6, :6]), _squared(velocity, covariance[:, 6:, 6:])


def mean_nees_interval(runs: int, probability: float = 0.95, dimension: int = 6) -> Array:
    """Return the interval (2,) that holds the mean NEES of independent runs with `probability`."""
    tail = (1 - probability) / 2
    bounds = chi2.ppf([tail, 1 - tail], runs * dimension) / runs
    return np.asarray(bounds, np.float64)


def _squared(error: Array, covariance: Array) -> Array:
    """Compute the squared Mahalanobis norms (N,) of errors (N, 6)."""
    return np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
