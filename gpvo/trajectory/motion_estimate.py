"""The motion at one time, as a robot needs it now: pose, velocity and how certain they are."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from factors import extrapolate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotionEstimate:
    """Pose and velocity at one time.

    Attributes
    ----------
    t
        Seconds since the recording's start.
    T_world_cam
        (4, 4) pose of the rectified left camera, in the trajectory's world.
    twist
        (6,) body velocity, rotation first, rad/s and m/s.
    covariance
        (12, 12) of pose and velocity; the pose is perturbed on the right, rotation first.
    qc
        (6,) power spectral density of the white noise on acceleration, rotation first.
    acceleration
        (6,) mean of the acceleration lately, rad/s^2 and m/s^2; 0 if it is unknown.
    white_covariance
        (12, 12) as the prior has it, for which acceleration is white noise; None if that is
        `covariance`, in which velocities are as certain as they proved to be.
    """

    t: float
    T_world_cam: Array
    twist: Array
    covariance: Array
    qc: Array
    acceleration: Array = field(default_factory=lambda: np.zeros(6))
    white_covariance: Array | None = None

    def by_prior(self) -> MotionEstimate:
        """Return the estimate with the covariance that the prior has."""
        covariance = self.white_covariance
        return self if covariance is None else replace(self, covariance=covariance)

    def at(self, t: float) -> MotionEstimate:
        """Extrapolate to a time t >= self.t, seconds, at constant velocity and with its noise.

        Raises
        ------
        ValueError
            If t is before, or not finite.
        """
        if not self.t <= t < np.inf:
            raise ValueError(f"t = {t} s must be finite and not before the estimate's {self.t} s")
        T, twist, covariance = extrapolate(
            self.T_world_cam[None],
            self.twist[None],
            np.array([t - self.t]),
            self.qc,
            self.covariance[None],
        )
        return MotionEstimate(t, T[0], twist[0], np.asarray(covariance)[0], self.qc)
