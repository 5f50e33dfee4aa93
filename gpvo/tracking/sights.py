"""Where landmarks were seen, and what the motion since then does to them and the image around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.kernels.compiled import kernel
from factors.kernels.se3 import copy_kernel
from factors.lie import se3_inverse
from gpvo.array_table import ArrayTable

Array = NDArray[np.float64]

LARGEST = 3.0
"""Largest change of a patch's size by a warp."""
UPRIGHT = np.eye(3, 2)
"""Warp that changes nothing."""


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
    columns = sights.point, sights.disparity, sights.T_start_cam
    return np.asarray(_predict_kernel(camera.parameters, se3_inverse(T_start_cam), *columns))


def warp(camera: StereoCamera, T_start_cam: Array, sights: Sights) -> Array:
    """Predict the warps (N, 3, 2) of the image around landmarks at a pose.

    A warp is the homography dp' = J dp / (1 + h dp) of pixels around the landmark's own, on a
    surface that faced the camera then. Its first rows are J, the last one is h:

        Q = R Z (x, y, 1) + t,  J = f / Q_z (dQ_xy - Q_xy / Q_z dQ_z),  h = dQ_z / Q_z

    with dQ / dp = R Z / f. What would be shrunk or enlarged more than LARGEST times is left as it
    is.
    """
    columns = sights.point, sights.disparity, sights.T_start_cam
    return np.asarray(_warp_kernel(camera.parameters, se3_inverse(T_start_cam), *columns))


def points_in_start(camera: StereoCamera, sights: Sights) -> Array:
    """Points (N, 3) of landmarks in the frame of which `T_start_cam` are poses."""
    columns = sights.point, sights.disparity, sights.T_start_cam
    return np.asarray(_points_kernel(camera.parameters, np.eye(4), *columns))


@kernel
def _predict_kernel(
    camera: Array, T_cam_start: Array, point: Array, disparity: Array, T_start_then: Array
) -> Array:
    found = _points_kernel(camera, T_cam_start, point, disparity, T_start_then)
    for i in range(len(found)):
        x, y, z = found[i]
        if z > 0:
            found[i, 0] = camera[0] * x / z + camera[2]
            found[i, 1] = camera[1] * y / z + camera[3]
            found[i, 2] = camera[0] * camera[4] / z
        else:
            found[i] = np.nan
    return found


@kernel
def _warp_kernel(
    camera: Array, T_cam_start: Array, point: Array, disparity: Array, T_start_then: Array
) -> Array:
    now = _points_kernel(camera, T_cam_start, point, disparity, T_start_then)
    warps, slope = np.empty((len(point), 3, 2)), np.empty((3, 2))
    for i in range(len(point)):
        depth = max(now[i, 2], 1e-6)
        scale = camera[0] * camera[4] / disparity[i] / depth
        for row in range(3):
            for k in range(2):
                slope[row, k] = scale * _product(T_cam_start, T_start_then[i], row, k)
        for row in range(2):
            for k in range(2):
                change = slope[row, k] - now[i, row] / depth * slope[2, k]
                warps[i, row, k] = change * camera[row] / camera[k]
        for k in range(2):
            warps[i, 2, k] = slope[2, k] / camera[k]
        area = warps[i, 0, 0] * warps[i, 1, 1] - warps[i, 0, 1] * warps[i, 1, 0]
        if not (LARGEST**-2 < area < LARGEST**2 and now[i, 2] > 0):
            copy_kernel(UPRIGHT, warps[i])
    return warps


@kernel
def _points_kernel(
    camera: Array, T_frame_start: Array, point: Array, disparity: Array, T_start_then: Array
) -> Array:
    """Compute the points (N, 3) of landmarks in a frame."""
    points, then, start = np.empty((len(point), 3)), np.empty(3), np.empty(3)
    for i in range(len(point)):
        then[2] = camera[0] * camera[4] / disparity[i]
        for k in range(2):
            then[k] = (point[i, k] - camera[2 + k]) * then[2] / camera[k]
        move(T_start_then[i], then, start)
        move(T_frame_start, start, points[i])
    return points


@kernel
def move(T: Array, point: Array, moved: Array) -> None:
    """Set a point (3,) moved by a transform (4, 4)."""
    for row in range(3):
        moved[row] = T[row, 0] * point[0] + T[row, 1] * point[1] + T[row, 2] * point[2] + T[row, 3]


@kernel
def _product(A: Array, B: Array, row: int, column: int) -> float:
    """Return an element of the product of two rotations."""
    return A[row, 0] * B[0, column] + A[row, 1] * B[1, column] + A[row, 2] * B[2, column]
