"""The velocity of MC-RANSAC beside what was expected of it: a few segments may agree by chance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.trajectory import MotionEstimate

Array = NDArray[np.float64]

MEASURED = 30
"""Number of segments that tell a velocity alone."""


def trusted_velocity(fit: VelocityFit | None, before: MotionEstimate | None, t: float) -> Array:
    """Return the body twist (6,) that the motion goes on with after time t, seconds.

    It is the measured one. Where fewer than MEASURED segments agree on that, it only corrects what
    the estimate before leads to, if there is one.
    """
    if fit is not None and (before is None or fit.inliers.sum() >= MEASURED):
        return fit.velocity
    if before is None:
        return np.zeros(6)
    ahead = before.by_prior().at(max(t, before.t))
    expected = ahead.twist + (ahead.t - before.t) * before.acceleration
    return fused_velocity(expected, ahead.covariance[6:, 6:], fit)


def fused_velocity(predicted: Array, covariance: Array, fit: VelocityFit | None) -> Array:
    """Correct a predicted twist (6,), of a covariance (6, 6), by the measured one, if any."""
    if fit is None:
        return predicted
    gain = covariance @ np.linalg.inv(covariance + fit.covariance)
    return np.asarray(predicted + gain @ (fit.velocity - predicted))
