"""Ground truth of a recording: camera motion and, if known, depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_inverse, se3_log
from factors.stereo import StereoCamera
from gpvo.simulation import SimulatedRecording
from gpvo.tracking import Measurements
from gpvo.trajectory import StampedPoses

Array = NDArray[np.float64]

_TICK = 1e-3
"""Time step of the finite difference of the true image motion, seconds."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The true motion and, if known, the true depth.

    Attributes
    ----------
    start, stop
        Recording times between which the motion is known, seconds.
    pose
        T_world_cam (N, 4, 4) of the rectified left camera at times (N,), seconds.
    depth
        Depth Z (N,) of rectified left pixels (N, 2) at times (N,), metres; None if unknown.
    name
        File, for messages.
    """

    start: float
    stop: float
    pose: Callable[[Array], Array]
    depth: Callable[[Array, Array], Array] | None = None
    name: str = "ground truth"

    def mean_twist(self, start: float, stop: float) -> Array:
        """Return the constant body twist (6,), rotation first, from one pose to the other."""
        first, last = self.pose(np.array([start, stop]))
        return se3_log(se3_inverse(first) @ last) / (stop - start)

    def disparity(self, seen: Measurements, camera: StereoCamera) -> Array:
        """Return the true disparity (N,) of measurements (N,), px; the measured one if unknown."""
        if self.depth is None:
            return seen.stereo[:, 2]
        return camera.fx * camera.baseline / self.depth(seen.t, seen.stereo[:, :2])

    def points(self, seen: Measurements, camera: StereoCamera) -> Array:
        """Return the world points (N, 3) of measurements (N,), metres."""
        stereo = np.column_stack([seen.stereo[:, :2], self.disparity(seen, camera)])
        T_world_cam = self.pose(seen.t)
        local = camera.triangulate(stereo)
        return np.einsum("nij,nj->ni", T_world_cam[:, :3, :3], local) + T_world_cam[:, :3, 3]

    def projection(self, points: Array, t: Array, camera: StereoCamera) -> Array:
        """Return projections (N, 3) of world points (N, 3) at times (N,); NaN behind the camera."""
        T_world_cam = self.pose(t)
        local = np.einsum("nji,nj->ni", T_world_cam[:, :3, :3], points - T_world_cam[:, :3, 3])
        local[local[:, 2] <= 0] = np.nan
        return camera.project(local)

    def image_velocity(self, points: Array, t: Array, camera: StereoCamera) -> Array:
        """Compute the image velocity (N, 2) of world points (N, 3) at times (N,), pixels/s."""
        before = np.clip(t - 0.5 * _TICK, self.start, self.stop - _TICK)
        first, last = (self.projection(points, at, camera) for at in (before, before + _TICK))
        return (last - first)[:, :2] / _TICK


def truth_of_poses(poses: StampedPoses, start_ns: int, name: str = Truth.name) -> Truth:
    """Return the truth from rectified left camera poses; `start_ns` is the stamp of t = 0."""
    start, stop = ((int(stamp) - start_ns) * 1e-9 for stamp in poses.stamps_ns[[0, -1]])

    def pose(t: Array) -> Array:
        stamps = start_ns + np.rint(np.clip(t, start, stop) * 1e9).astype(np.int64)
        stamps = np.clip(stamps, poses.stamps_ns[0], poses.stamps_ns[-1])
        unique, inverse = np.unique(stamps, return_inverse=True)
        return poses.interpolate(unique).T_world_cam[inverse]

    return Truth(start, stop, pose, name=name)


def truth_of_simulation(recording: SimulatedRecording) -> Truth:
    """Return the exact motion and depth of a simulated recording."""
    K = recording.rig.K_rect

    def depth(t: Array, pixels: Array) -> Array:
        poses = recording.motion.pose(t)
        looks = [
            recording.scene.depth(pixel[None], K, pose)
            for pixel, pose in zip(pixels, poses, strict=True)
        ]
        return np.concatenate([np.empty(0), *looks])

    return Truth(0.0, recording.duration, recording.motion.pose, depth)
