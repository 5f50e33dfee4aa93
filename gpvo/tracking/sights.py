"""Where landmarks were seen, and what the motion since then does to them and the image around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_inverse
from gpvo.array_table import ArrayTable

Array = NDArray[np.float64]

LARGEST = 3.0
"""Largest change of a patch's size by a warp."""


@dataclass(frozen=True, eq=False)
class Sights(ArrayTable):
    """Where N landmarks were seen, each in a frame of its own.

    Attributes
    ----------
    point
        (N, 2) left pixel.
    disparity
        (N,) pixels.
    T_start_cam
        (N, 4, 4) pose of the frame.
    """

    point: Array
    disparity: Array
    T_start_cam: Array

    @classmethod
    def of_frame(
        cls, left: NDArray[np.float32], right: NDArray[np.float32], T_start_cam: Array
    ) -> Sights:
        """Return the sights of one frame: left and right pixels (N, 2), and its pose (4, 4)."""
        point = left.astype(np.float64)
        poses = np.repeat(T_start_cam[None], len(point), axis=0)
        return cls(point, point[:, 0] - right[:, 0], poses)

    @property
    def measured(self) -> Array:
        """Measurements (N, 3), (u_left, v, disparity)."""
        return np.column_stack([self.point, self.disparity])


def predict(camera: StereoCamera, T_start_cam: Array, sights: Sights) -> Array:
    """Predict the measurements (N, 3) of landmarks at a pose, (u_left, v, disparity), pixels.

    NaN for landmarks behind the camera.
    """
    points = _points(camera, _since(T_start_cam, sights), sights)
    points[points[:, 2] <= 0] = np.nan
    return camera.project(points)


def warp(camera: StereoCamera, T_start_cam: Array, sights: Sights) -> Array:
    """Predict the warps (N, 2, 2) of the image around landmarks at a pose.

    A warp is the Jacobian of the new pixel with respect to the old one, on a surface that faced the
    camera then:

        Q = R Z (x, y, 1) + t,  dp'/dp = f / Q_z (dQ_xy - Q_xy / Q_z dQ_z),  dQ/dp = R Z / f

    What would be shrunk or enlarged more than LARGEST times is left as it is.
    """
    T_now_then = _since(T_start_cam, sights)
    focal = np.array([camera.fx, camera.fy])
    now = _points(camera, T_now_then, sights)
    depth = np.maximum(now[:, 2], 1e-6)[:, None, None]
    scale = camera.fx * camera.baseline / sights.disparity[:, None, None]
    slope = T_now_then[:, :3, :2] * scale / depth
    change = slope[:, :2] - now[:, :2, None] / depth * slope[:, 2:]
    warps = change * focal[:, None] / focal
    area = np.linalg.det(warps)
    plausible = (area > LARGEST**-2) & (area < LARGEST**2) & (now[:, 2] > 0)
    return np.where(plausible[:, None, None], warps, np.eye(2))


def points_in_start(camera: StereoCamera, sights: Sights) -> Array:
    """Points (N, 3) of landmarks in the frame of which `T_start_cam` are poses."""
    return _points(camera, sights.T_start_cam, sights)


def _since(T_start_cam: Array, sights: Sights) -> Array:
    """Poses (N, 4, 4) of the cameras of then in the one of now."""
    return se3_inverse(T_start_cam) @ sights.T_start_cam


def _points(camera: StereoCamera, T: Array, sights: Sights) -> Array:
    """Points (N, 3) of landmarks in the frame in which T (N, 4, 4) are the cameras' poses."""
    then = camera.triangulate(sights.measured)
    return np.einsum("nij,nj->ni", T[:, :3, :3], then) + T[:, :3, 3]
