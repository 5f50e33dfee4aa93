"""Choose new features by what they tell of the pose, for as long as the motion keeps them in view.

Near features tell the translation and far ones the rotation, those of one place tell the same. A
landmark that is seen in n frames tells n J^T J, where J is the Jacobian of its measurement with
respect to the pose. Greedily, as by Carlone and Karaman, "Attention and Anticipation in Fast
Visual-Inertial Navigation", T-RO 2019, the next feature is the one that makes the determinant of
the pose's covariance least, beside the landmarks that are known and those chosen before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_kernel, copy_vector_kernel
from factors.lie import se3_inverse
from gpvo.tracking.pose_of_matches import jacobian_of_pose
from gpvo.tracking.sights import move

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HORIZON = 16
"""Number of frames for which the motion is foreseen: it goes on as it was."""


def whitened_jacobians(
    camera: StereoCamera, T_before_now: Array, shape: tuple[int, int], measured: Array
) -> Array:
    """Compute the rows (N, 3, 6) whose squares are what landmarks tell of a pose while in view.

    Measurements have the standard deviation of a pixel.

    Parameters
    ----------
    T_before_now
        (4, 4) motion from one frame to the next.
    shape
        (height, width) of the image, pixels.
    measured
        (N, 3) measurements now, (u_left, v, disparity), pixels.
    """
    points = camera.triangulate(measured)
    _, by_pose = jacobian_of_pose(camera, np.eye(4), points)
    frames = frames_in_view(camera, T_before_now, shape, points)
    return np.asarray(by_pose * np.sqrt(frames)[:, None, None])


def frames_in_view(
    camera: StereoCamera, T_before_now: Array, shape: tuple[int, int], points: Array
) -> NDArray[np.int64]:
    """Count the frames (N,) from now on, HORIZON at most, in which points (N, 3) are in view."""
    given = camera.parameters, se3_inverse(T_before_now), shape, points
    return np.asarray(_frames_in_view_kernel(*given))


@kernel
def _frames_in_view_kernel(
    camera: Array, T_next_now: Array, shape: tuple[int, int], points: Array
) -> NDArray[np.int64]:
    frames, now, there = np.zeros(len(points), np.int64), np.empty(3), np.empty(3)
    for i in range(len(points)):
        copy_vector_kernel(points[i], now)
        while frames[i] < HORIZON and _is_in_view(camera, shape, now):
            frames[i] += 1
            move(T_next_now, now, there)
            copy_vector_kernel(there, now)
    return frames


@kernel
def _is_in_view(camera: Array, shape: tuple[int, int], point: Array) -> bool:
    """Tell whether a point (3,) of the camera's frame is before it and within the image."""
    x, y, z = point
    u, v = camera[0] * x / z + camera[2], camera[1] * y / z + camera[3]
    return bool(z > 0 and 0 <= u < shape[1] and 0 <= v < shape[0])


def most_telling(rows: Array, known: int, count: int) -> Mask:
    """Choose `count` of the N landmarks after the known ones; return whether each is chosen (N,).

    `rows` (known + N, 3, 6) are the whitened Jacobians of all. Before any is seen the pose is
    taken to be known to a radian and a metre.
    """
    covariance = np.linalg.inv(np.eye(6) + np.einsum("nki,nkj->ij", rows[:known], rows[:known]))
    return np.asarray(_most_telling_kernel(covariance, rows[known:], count))


@kernel
def _most_telling_kernel(covariance: Array, rows: Array, count: int) -> Mask:
    """Choose greedily; what a landmark tells is computed again only while it may be the most.

    It never tells more once others were chosen.
    """
    chosen, tried = np.zeros(len(rows), np.bool_), np.empty_like(covariance)
    most, asked = np.full(len(rows), np.inf), np.full(len(rows), -1)
    for number in range(min(count, len(rows))):
        best = np.argmax(most)
        while asked[best] < number:
            copy_kernel(covariance, tried)
            most[best], asked[best] = _learn(tried, rows[best]), number
            best = np.argmax(most)
        chosen[best], most[best] = True, -np.inf
        _learn(covariance, rows[best])
    return chosen


@kernel
def _learn(covariance: Array, rows: Array) -> float:
    """Condition a covariance S (6, 6) on a landmark's rows (3, 6) b, one after the other.

    S - S b b^T S / (1 + b^T S b). Returns by what the logarithm of its determinant shrinks.
    """
    gain, seen = 0.0, np.empty(6)
    for row in rows:
        variance = 1.0
        for i in range(6):
            seen[i] = 0.0
            for j in range(6):
                seen[i] += covariance[i, j] * row[j]
            variance += seen[i] * row[i]
        gain += np.log(variance)
        for i in range(6):
            for j in range(6):
                covariance[i, j] -= seen[i] * seen[j] / variance
    return gain
