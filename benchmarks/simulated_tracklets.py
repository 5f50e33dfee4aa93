"""Simulate tracklets without events: a motion of the WNOA prior, points, noisy measurements.

The estimator's assumptions hold exactly here, so that its covariances can be tested.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera, wnoa_covariance
from factors.lie import se3_exp, se3_inverse, se3_right_jacobian
from gpvo.config import NoiseConfig
from gpvo.tracking import Measurements
from gpvo.trajectory import States

Array = NDArray[np.float64]

CAMERA = StereoCamera(226.0, 226.0, 173.0, 130.0, 0.10)
"""A pair of DAVIS 346, like that of MVSEC."""

IMAGE = np.array([346.0, 260.0])


@dataclass(frozen=True)
class TrackletSimulation:
    """Clusters of tracklets of a random motion.

    Attributes
    ----------
    noise
        Noise of the motion and the measurements, and standard deviation of the first velocity.
    per_cluster
        New landmarks in each cluster.
    length
        Number of clusters in which a landmark is measured, while it is in view.
    period
        Duration of a cluster, seconds.
    disparity
        Range of the landmarks' disparities when they are new, pixels.
    camera
        The rectified pair.
    """

    noise: NoiseConfig
    per_cluster: int = 10
    length: int = 5
    period: float = 0.05
    disparity: tuple[float, float] = (12.0, 40.0)
    camera: StereoCamera = CAMERA

    def motion(self, duration: float, rng: np.random.Generator) -> States:
        """Draw a sample of the WNOA process every 5 ms, starting at the origin at t = 0."""
        dt = 0.005
        root = np.linalg.cholesky(wnoa_covariance(dt, self.noise.acceleration_psd))
        T, twist = [np.eye(4)], [self.noise.initial_velocity * rng.standard_normal(6)]
        for _ in range(int(np.ceil(duration / dt))):
            deviation = root @ rng.standard_normal(12)
            xi = dt * twist[-1] + deviation[:6]
            T.append(T[-1] @ se3_exp(xi))
            twist.append(se3_right_jacobian(xi) @ (twist[-1] + deviation[6:]))
        t = dt * np.arange(len(T), dtype=np.float64)
        return States(t, np.array(T), np.array(twist))

    def clusters(
        self, motion: States, rng: np.random.Generator
    ) -> Iterator[tuple[float, Measurements]]:
        """Yield the end of each cluster and its measurements, in time order, whole microseconds."""
        number, points = np.empty(0, np.int64), np.empty((0, 3))
        for frame in range(int(np.floor(motion.t[-1] / self.period + 1e-9))):
            first = frame * self.per_cluster
            number = np.concatenate([number, np.arange(first, first + self.per_cluster)])
            points = np.concatenate([points, self._new_points(frame, motion, rng)])
            live = number // self.per_cluster > frame - self.length
            number, points = number[live], points[live]
            yield (frame + 1) * self.period, self._measured(frame, number, points, motion, rng)

    def _measured(
        self,
        frame: int,
        number: NDArray[np.int64],
        points: Array,
        motion: States,
        rng: np.random.Generator,
    ) -> Measurements:
        """Return noisy measurements, at random times, of the points (N, 3) that are in view."""
        t = np.sort(np.round((frame + rng.random(len(number))) * self.period, 6))
        order = rng.permutation(len(number))
        number, points = number[order], points[order]
        T_cam_world = se3_inverse(motion.query(t)[0])
        local = np.einsum("nij,nj->ni", T_cam_world[:, :3, :3], points) + T_cam_world[:, :3, 3]
        seen = np.flatnonzero(local[:, 2] > 0.1)
        stereo = self.camera.project(local[seen])
        inside = ((stereo[:, :2] > 0) & (stereo[:, :2] < IMAGE)).all(axis=1)
        seen, stereo = seen[inside], stereo[inside]
        deviation = 1 / np.sqrt(np.array(self.noise.measurement_information))
        stereo = stereo + deviation * rng.standard_normal(stereo.shape)
        return Measurements(number[seen], np.full(len(seen), frame), t[seen], stereo)

    def _new_points(self, frame: int, motion: States, rng: np.random.Generator) -> Array:
        """Return world points (per_cluster, 3) that are in view in the middle of a cluster."""
        low, high = self.disparity
        corner = [0.1 * IMAGE[0], 0.1 * IMAGE[1], low]
        stereo = rng.uniform(corner, [0.9 * IMAGE[0], 0.9 * IMAGE[1], high], (self.per_cluster, 3))
        T, _ = motion.query(np.array([(frame + 0.5) * self.period]))
        return self.camera.triangulate(stereo) @ T[0, :3, :3].T + T[0, :3, 3]
