"""Landmarks as they were known before a break, which tell where the camera is after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_adjoint, se3_inverse
from gpvo.config.stages import NoiseConfig
from gpvo.estimator.known_landmarks import track_drift
from gpvo.estimator.landmark_looks import REVERSED
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.mc_ransac.moved_points import moved_points
from gpvo.tracking.measurements import Measurements
from gpvo.tracking.pose_of_matches import agreeing, jacobian_of_pose, pose_of_matches

Array = NDArray[np.float64]


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
    """

    number: NDArray[np.int64]
    points: Array
    seen_from: PoseInWorld

    def pose(
        self, camera: StereoCamera, noise: NoiseConfig, new: Measurements, velocity: VelocityFit
    ) -> PoseInWorld | None:
        """Find the pose at the first of new measurements; None if too few are of known landmarks.

        Their tracks may go on elsewhere on them: they are taken to look as different as can be.
        """
        t, twist = new.t.min(), velocity.velocity
        _, i, j = np.intersect1d(self.number, new.landmark, return_indices=True)
        points = moved_points(camera.triangulate(new.stereo[j]), t - new.t[j], twist)
        known, measured = self.points[i], camera.project(points)
        T = pose_of_matches(camera, known, measured)
        if T is None:
            return None
        _, jacobian = jacobian_of_pose(camera, T, known[agreeing(camera, T, known, measured)])
        moved = track_drift(noise, np.array([REVERSED]))[0]
        variance = moved**2 + 1 / np.array(noise.measurement_information)
        information = np.einsum("nri,r,nrj->ij", jacobian, 1 / variance, jacobian)
        around = self.seen_from.carried_to(T[None])[0]
        return PoseInWorld(T, around + np.linalg.inv(information))
