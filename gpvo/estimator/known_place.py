"""Landmarks as they were known before a break, which tell where the camera is after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_adjoint, se3_inverse, se3_log
from gpvo.config.stages import NoiseConfig
from gpvo.estimator.known_landmarks import track_drift
from gpvo.estimator.landmark_looks import REVERSED
from gpvo.mc_ransac.moved_points import moved_points
from gpvo.tracking.measurements import Measurements
from gpvo.tracking.pose_of_matches import agreeing, jacobian_of_pose, pose_of_matches
from gpvo.trajectory.states import States

Array = NDArray[np.float64]

FARTHEST = 40.0
"""Standard deviations that the way to a place is off the one that the velocities tell, at most.

By the Q_c of before alone: after 115 breaks of 0.5 to 1 s right places were off by up to 23, houses
of a street that look like those 10 m before by 470 and more.
"""
USUAL_SPEED = 1.0
"""Speed, rad/s and m/s, or that seen lately, by which the mean one in a break may always differ.

Q_c is small in steady motion, after which a camera may turn all the same.
"""


@dataclass(frozen=True, eq=False)
class PoseInWorld:
    """A pose T_world_cam (4, 4), and its covariance (6, 6), perturbed on the right."""

    T_world_cam: Array
    covariance: Array

    def adjoint_to(self, T_world_cam: Array) -> Array:
        """Return the matrices (N, 6, 6) that make errors of poses (N, 4, 4) of this one's error."""
        return se3_adjoint(se3_inverse(T_world_cam) @ self.T_world_cam)

    def carried_to(self, T_world_cam: Array) -> Array:
        """Return what poses (N, 4, 4) are uncertain by as this one is, (N, 6, 6)."""
        if not self.covariance.any():
            return np.zeros((len(T_world_cam), 6, 6))
        moved = self.adjoint_to(T_world_cam)
        return np.asarray(moved @ self.covariance @ moved.transpose(0, 2, 1))


@dataclass(frozen=True, eq=False)
class KnownPlace:
    """Landmarks when their measurements ceased.

    Attributes
    ----------
    number, points
        (L,) increasing identities, and their points (L, 3) in the world.
    seen_from
        A pose from which they were measured.
    last
        (1,) last state that was measured.
    """

    number: NDArray[np.int64]
    points: Array
    seen_from: PoseInWorld
    last: States

    def known(self, new: Measurements) -> int:
        """Return how many of the landmarks are measured anew."""
        return len(np.intersect1d(self.number, new.landmark))

    def pose(
        self,
        camera: StereoCamera,
        noise: NoiseConfig,
        new: Measurements,
        twist: Array,
        speed: Array,
        least: int,
    ) -> PoseInWorld | None:
        """Find the pose at the first of new measurements, during which the twist (6,) is known.

        The speed (2,) is the largest of before, rad/s and m/s.
        None if fewer than `least` are of known landmarks, or it is out of reach. Their tracks may
        go on elsewhere on them: they are taken to look as different as can be.
        """
        t = new.t.min()
        _, i, j = np.intersect1d(self.number, new.landmark, return_indices=True)
        points = moved_points(camera.triangulate(new.stereo[j]), t - new.t[j], twist)
        known, measured = self.points[i], camera.project(points)
        T = pose_of_matches(camera, known, measured, least)
        if T is None or not self._is_in_reach(T, t, twist, np.array(noise.acceleration_psd), speed):
            return None
        _, jacobian = jacobian_of_pose(camera, T, known[agreeing(camera, T, known, measured)])
        moved = track_drift(noise, np.array([REVERSED]))[0]
        variance = moved**2 + 1 / np.array(noise.measurement_information)
        information = np.einsum("nri,r,nrj->ij", jacobian, 1 / variance, jacobian)
        around = self.seen_from.carried_to(T[None])[0]
        return PoseInWorld(T, around + np.linalg.inv(information))

    def _is_in_reach(self, T: Array, t: float, twist: Array, qc: Array, speed: Array) -> bool:
        """Return whether the camera could get to a pose (4, 4), where it moves at a twist (6,).

        The mean of the WNOA prior between the two states is half the sum of their twists times the
        time dt, to first order, and the covariance Q_c dt^3 / 12. A twist of a few measurements may
        be wild: that of before may be the better one.
        """
        dt, before = t - self.last.t[0], self.last.twist[0]
        least = dt * np.repeat(np.maximum(speed, USUAL_SPEED), 3) / FARTHEST
        deviation = np.sqrt(qc * dt**3 / 12 + least**2)
        way = se3_log(se3_inverse(self.last.T_world_cam[0]) @ T)
        off = [(way - 0.5 * dt * (before + after)) / deviation for after in (twist, before)]
        return bool(min(map(np.linalg.norm, off)) < FARTHEST)
