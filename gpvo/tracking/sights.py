"""Where landmarks were seen, and what the motion since then does to them and the image around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_kernel, product_kernel
from factors.lie import se3_inverse
from gpvo.array_table import ArrayTable

Array = NDArray[np.float64]

LARGEST = 3.0
"""Largest change of a patch's size by a warp."""
LARGEST_SLOPE = 0.5
"""Largest change of the disparity from a pixel to the next."""
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
    slope
        (N, 2) by how much the disparity is larger a pixel to the right, and below: that of the
        surface.
    """

    point: Array
    disparity: Array
    T_start_cam: Array
    slope: Array

    @classmethod
    def of_frame(
        cls,
        left: NDArray[np.float32],
        right: NDArray[np.float32],
        T_start_cam: Array,
        slope: Array | None = None,
    ) -> Sights:
        """Return the sights of one frame: left and right pixels (N, 2), and its pose (4, 4).

        Surfaces face the camera if their slopes (N, 2) are not known.
        """
        point = left.astype(np.float64)
        poses = np.repeat(T_start_cam[None], len(point), axis=0)
        slope = np.zeros((len(point), 2)) if slope is None else slope
        return cls(point, point[:, 0] - right[:, 0], poses, slope)

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

    A warp is the homography dp' = J dp / (1 + h dp) of pixels around the landmark's own, on a plane
    through it with the disparity d + g . dp then. Its first rows are J, the last one is h:

        Q = R Z (x, y, 1) + t,  J = f / Q_z (dQ_xy - Q_xy / Q_z dQ_z),  h = dQ_z / Q_z

    with dQ / dp = R Z / f + t g / d, up to a factor of all Q. What would be shrunk or enlarged more
    than LARGEST times is left as it is.
    """
    columns = sights.point, sights.disparity, sights.T_start_cam, sights.slope
    return np.asarray(_warp_kernel(camera.parameters, se3_inverse(T_start_cam), *columns))


def slopes(camera: StereoCamera, T_start_cam: Array, sights: Sights) -> Array:
    """Return the slopes (N, 2) that the surfaces of landmarks have as they are seen from a pose.

    A plane is n . X = 1, with the disparity f_u b n . (x, y, 1) along its rays. Seen from another
    pose it is R^T n / (1 - n . t). Those beyond LARGEST_SLOPE are cut off.
    """
    scale = camera.parameters[:2] / (camera.parameters[0] * camera.parameters[4])
    rays = (sights.point - camera.parameters[2:4]) / camera.parameters[:2]
    plane = np.empty((len(sights), 3))
    plane[:, :2] = sights.slope * scale
    plane[:, 2] = scale[0] / camera.parameters[0] * sights.disparity
    plane[:, 2] -= (plane[:, :2] * rays).sum(axis=1)
    T_then_now = se3_inverse(sights.T_start_cam) @ T_start_cam
    behind = 1 - np.einsum("ni,ni->n", plane, T_then_now[:, :3, 3])
    now = np.einsum("nij,ni->nj", T_then_now[:, :3, :2], plane) / scale
    return np.clip(now / np.maximum(behind, 1e-3)[:, None], -LARGEST_SLOPE, LARGEST_SLOPE)


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
    camera: Array,
    T_cam_start: Array,
    point: Array,
    disparity: Array,
    T_start_then: Array,
    gradient: Array,
) -> Array:
    now = _points_kernel(camera, T_cam_start, point, disparity, T_start_then)
    warps, slope = np.empty((len(point), 3, 2)), np.empty((3, 2))
    for i in range(len(point)):
        depth = max(now[i, 2], 1e-6)
        scale = camera[0] * camera[4] / disparity[i] / depth
        T_cam_then = product_kernel(T_cam_start, T_start_then[i])
        for row in range(3):
            for k in range(2):
                bent = T_cam_then[row, 3] / depth * gradient[i, k] * camera[k] / disparity[i]
                slope[row, k] = scale * T_cam_then[row, k] + bent
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
