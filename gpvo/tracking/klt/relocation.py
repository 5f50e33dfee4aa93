"""The pose of a frame after a gap, during which the motion may have been any.

Lost landmarks are compared with all features of the frame, wherever a prediction would have them.
Three right matches determine the pose (RANSAC); those that agree with it refine it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse, se3_log, skew
from gpvo.tracking.klt.anchors import Anchors, match_anchors, warped_patches
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.lost_landmarks import LastSights
from gpvo.tracking.sights import points_in_start, warp

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROLL = 0.4
"""Turn of a guessed pose around the optical axis, rad: it changes patches most."""
CELL = 2
"""Side of the cells whose means are compared, pixels: features are not just where landmarks are."""
CANDIDATES = 2
"""Features that are most alike, with each of which a landmark is matched."""
FARTHEST = 6.0
"""Largest distance of a match from its feature, pixels."""
SAMPLES = 4000
"""Triples of matches from which a pose is made."""
TOLERANCE = 3.0
"""Largest error of a match that agrees with a pose, pixels of (u_left, v, disparity)."""
LEAST = 10
"""Least number of matches that agree: chance matches agree in three or four."""
STEPS = 5
"""Gauss-Newton steps in which the pose is refined on the matches that agree."""


def relocated_pose(
    camera: StereoCamera, frame: Frame, lost: LastSights, least_correlation: float
) -> Array | None:
    """Find the pose T_start_cam (4, 4) of a frame by landmarks that were lost before it.

    The frame's own landmarks are its features. None if too few landmarks agree.
    """
    if len(lost) < LEAST:
        return None
    for guess in _guesses(lost.sights.T_start_cam[-1], frame.T_start_cam):
        warps = warp(camera, guess, lost.anchors.sights)
        landmark, measured = _matches(frame, lost.anchors, warps, least_correlation)
        points = points_in_start(camera, lost.sights)[landmark]
        if len(points) >= LEAST:
            T = _fitted(camera, _best_of_samples(camera, points, measured), points, measured)
            if T is not None:
                return T
    return None


def _guesses(before: Array, ahead: Array) -> list[Array]:
    """Poses (4, 4) that may warp the patches well enough, given those of before and predicted.

    The camera may have gone on, or stopped or turned back; it may have rolled.
    """
    half = before @ se3_exp(0.5 * se3_log(se3_inverse(before) @ ahead))
    rolled = [half @ se3_exp([0, 0, roll, 0, 0, 0]) for roll in (ROLL, -ROLL)]
    return [ahead, half, before, *rolled]


def refined_pose(camera: StereoCamera, frame: Frame, lost: LastSights) -> Array | None:
    """Refine the pose T_start_cam (4, 4) of a frame by the lost landmarks that were found in it.

    None if too few agree.
    """
    _, i, j = np.intersect1d(lost.landmark, frame.landmark, return_indices=True)
    measured = np.hstack([frame.left, frame.left[:, :1] - frame.right[:, :1]])[j]
    points = points_in_start(camera, lost.sights)[i]
    return _fitted(camera, frame.T_start_cam, points, measured.astype(np.float64))


def _fitted(camera: StereoCamera, T: Array, points: Array, measured: Array) -> Array | None:
    """Fit a pose to the points (N, 3) that agree with it; None if too few do."""
    for _ in range(STEPS):
        agree = _agree(camera, T[None], points, measured)[0]
        if agree.sum() < LEAST:
            return None
        T = _refined(camera, T, points[agree], measured[agree])
    return T


def _matches(
    frame: Frame, anchors: Anchors, warps: Array, least_correlation: float
) -> tuple[Index, Array]:
    """Match anchors under their warps (N, 2, 2) with a frame around its features.

    Returns which landmark each match (N,) is of, and (u_left, v, disparity) there (N, 3).
    """
    landmark, feature = _most_alike(frame, anchors, warps)
    guess = frame.left[feature]
    left, alike = match_anchors(anchors[landmark], warps[landmark], frame.left_image, guess)
    good = (alike >= least_correlation) & (np.linalg.norm(left - guess, axis=1) < FARTHEST)
    disparity = (frame.left - frame.right)[feature, :1]
    return landmark[good], np.hstack([left, disparity])[good].astype(np.float64)


def _most_alike(frame: Frame, anchors: Anchors, warps: Array) -> tuple[Index, Index]:
    """Return pairs of landmarks and those of the frame's features that look most like them."""
    side, upright = frame.left_image.patch_size, np.tile(np.eye(2), (len(frame.left), 1, 1))
    seen = warped_patches(Anchors.of_image(frame.left_image, frame.sights), upright, side)
    known = warped_patches(anchors, warps, side)
    alike = _normalised(known) @ _normalised(seen).T
    best = np.argsort(-alike, axis=1, kind="stable")[:, :CANDIDATES]
    return np.repeat(np.arange(len(anchors)), best.shape[1]), best.ravel()


def _normalised(patches: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of the cells of patches (N, side, side), without their mean and of length 1."""
    count, cells = len(patches), patches.shape[1] // CELL
    whole = patches[:, : cells * CELL, : cells * CELL].reshape(count, cells, CELL, cells, CELL)
    means = whole.mean(axis=(2, 4)).reshape(count, cells**2)
    means -= means.mean(axis=1, keepdims=True)
    return means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), np.float32(1e-6))


def _best_of_samples(camera: StereoCamera, points: Array, measured: Array) -> Array:
    """Return the pose (4, 4) of three matches with which most agree; of points (N, 3) in start."""
    rng = np.random.default_rng(0)
    samples = rng.integers(0, len(points), (SAMPLES, 3))
    seen = camera.triangulate(measured)
    there, here = _corners(points[samples]), _corners(seen[samples])
    T = np.tile(np.eye(4), (SAMPLES, 1, 1))
    T[:, :3, :3] = there @ here.transpose(0, 2, 1)
    middle = seen[samples].mean(axis=1)
    T[:, :3, 3] = points[samples].mean(axis=1) - np.einsum("nij,nj->ni", T[:, :3, :3], middle)
    return np.asarray(T[_agree(camera, T, points, measured).sum(axis=1).argmax()])


def _corners(triangles: Array) -> Array:
    """Right-handed frames (N, 3, 3) of triangles (N, 3 corners, 3); zero for those without area."""
    along, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(along, other)
    axes = np.stack([along, np.cross(normal, along), normal], axis=2)
    return axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)


def _agree(camera: StereoCamera, T: Array, points: Array, measured: Array) -> NDArray[np.bool_]:
    """Tell which points (N, 3) are measured (N, 3) where poses (K, 4, 4) see them, as (K, N)."""
    return _agree_kernel(T, points, measured, camera.parameters)


@njit(cache=True, nogil=True)
def _agree_kernel(
    T_start_cam: Array, points: Array, measured: Array, camera: Array
) -> NDArray[np.bool_]:
    fx, fy, cx, cy, baseline = camera
    agree = np.zeros((len(T_start_cam), len(points)), np.bool_)
    for k in range(len(T_start_cam)):
        R, t = T_start_cam[k, :3, :3], T_start_cam[k, :3, 3]
        for n in range(len(points)):
            a, b, c = points[n, 0] - t[0], points[n, 1] - t[1], points[n, 2] - t[2]
            z = R[0, 2] * a + R[1, 2] * b + R[2, 2] * c
            if z > 0:
                u = fx * (R[0, 0] * a + R[1, 0] * b + R[2, 0] * c) / z + cx - measured[n, 0]
                v = fy * (R[0, 1] * a + R[1, 1] * b + R[2, 1] * c) / z + cy - measured[n, 1]
                d = fx * baseline / z - measured[n, 2]
                agree[k, n] = u * u + v * v + d * d < TOLERANCE**2
    return agree


def _refined(camera: StereoCamera, T: Array, points: Array, measured: Array) -> Array:
    """Take one Gauss-Newton step of a pose, perturbed on the right."""
    seen = (points - T[:3, 3]) @ T[:3, :3]
    predicted, by_point = camera.project_with_jacobian(seen)
    by_twist = np.concatenate([skew(seen), -np.broadcast_to(np.eye(3), (len(seen), 3, 3))], axis=2)
    jacobian = (by_point @ by_twist).reshape(-1, 6)
    step, *_ = np.linalg.lstsq(jacobian, (measured - predicted).ravel(), rcond=None)
    return np.asarray(T @ se3_exp(step))
