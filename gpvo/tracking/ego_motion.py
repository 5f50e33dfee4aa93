"""Motion of the camera between two frames, and what it does to the image around a landmark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp

Array = NDArray[np.float64]

LARGEST = 3.0
"""Largest change of a patch's size by a warp."""


class EgoMotion:
    """Poses of the frames, by the latest velocity of MC-RANSAC from the latest pose that is known.

    They warp patches of frames that are apart in time, and say where a landmark will be in the next
    frame; no measurement is made of them.

    Attributes
    ----------
    velocity
        (6,) body twist of the latest cluster, rad/s and m/s.
    T_start_cam
        (4, 4) pose of the latest frame.
    """

    def __init__(self) -> None:
        self.velocity, self.T_start_cam = np.zeros(6), np.eye(4)
        self._t: float | None = None

    def restart(self, t: float, T_start_cam: Array) -> None:
        """Go on from a pose at time t, seconds, that is known better."""
        self.T_start_cam, self._t = T_start_cam, t

    def advance(self, t: float) -> None:
        """Move on to a frame at time t, seconds."""
        dt = 0.0 if self._t is None else t - self._t
        self.T_start_cam = self.T_start_cam @ se3_exp(dt * self.velocity)
        self._t = t


def camera_of_pixels(camera: StereoCamera, side: int) -> StereoCamera:
    """Return the camera in pixels `side` of the sensor's pixels wide."""
    shift = (side - 1) / 2
    return replace(
        camera,
        fx=camera.fx / side,
        fy=camera.fy / side,
        cx=(camera.cx - shift) / side,
        cy=(camera.cy - shift) / side,
    )


def predict(camera: StereoCamera, T_now_then: Array, points: Array, disparity: Array) -> Array:
    """Predict the measurements (N, 3) of landmarks, (u_left, v, disparity), pixels.

    Poses, pixels and disparities are those of `warp`. NaN for landmarks behind the camera.
    """
    now = _moved(camera, T_now_then, points, disparity)
    now[now[:, 2] <= 0] = np.nan
    return camera.project(now)


def _moved(camera: StereoCamera, T_now_then: Array, points: Array, disparity: Array) -> Array:
    """Points (N, 3) of landmarks in the camera frame of now."""
    then = camera.triangulate(np.column_stack([points, disparity]))
    return np.einsum("nij,nj->ni", T_now_then[:, :3, :3], then) + T_now_then[:, :3, 3]


def warp(camera: StereoCamera, T_now_then: Array, points: Array, disparity: Array) -> Array:
    """Predict the warps (N, 2, 2) of the image around landmarks.

    T_now_then (N, 4, 4) are the poses of the frames in which the landmarks had the pixels `points`
    (N, 2) and the disparities (N,), in the camera frame of now. A warp is the Jacobian of the new
    pixel with respect to the old one, on a surface that faced the camera then:

        Q = R Z (x, y, 1) + t,  dp'/dp = f / Q_z (dQ_xy - Q_xy / Q_z dQ_z),  dQ/dp = R Z / f

    What would be shrunk or enlarged more than LARGEST times is left as it is.
    """
    focal = np.array([camera.fx, camera.fy])
    now = _moved(camera, T_now_then, points, disparity)
    depth = np.maximum(now[:, 2], 1e-6)[:, None, None]
    slope = T_now_then[:, :3, :2] * camera.fx * camera.baseline / disparity[:, None, None] / depth
    change = slope[:, :2] - now[:, :2, None] / depth * slope[:, 2:]
    warps = change * focal[:, None] / focal
    area = np.linalg.det(warps)
    plausible = (area > LARGEST**-2) & (area < LARGEST**2) & (now[:, 2] > 0)
    return np.where(plausible[:, None, None], warps, np.eye(2))
