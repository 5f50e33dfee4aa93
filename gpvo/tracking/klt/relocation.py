"""The pose of a frame after a gap, during which the motion may have been any.

Lost landmarks are compared with all features of the frame, wherever a prediction would have them.
Three right matches determine the pose (RANSAC); those that agree with it refine it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.tracking.klt.anchors import Anchors, match_anchors, warped_patches
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.lost_landmarks import LastSights
from gpvo.tracking.pose_of_matches import fitted_pose, pose_of_matches
from gpvo.tracking.sights import UPRIGHT, points_in_start, warp

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROLL = 0.4
"""Turn of a guessed pose around the optical axis, rad: it changes patches most."""
CELL = 2
"""Side of the cells whose means are compared, pixels: features are not just where landmarks are."""
CANDIDATES = 4
"""Landmarks that are most alike, with each of which a feature is matched."""
LEAST = 7
"""Least number of matches that agree; then more landmarks are to be found where the pose has them.

By chance three or four agree.
"""
FARTHEST = 6.0
"""Largest distance of a match from its feature, pixels."""


def relocated_pose(
    camera: StereoCamera, frame: Frame, lost: LastSights, least_correlation: float
) -> Array | None:
    """Find the pose T_start_cam (4, 4) of a frame by landmarks that were lost before it.

    The frame's own landmarks are its features. None if too few landmarks agree.
    """
    if not len(lost):
        return None
    for guess in _guesses(lost.sights.T_start_cam[-1], frame.T_start_cam):
        warps = warp(camera, guess, lost.anchors.sights)
        landmark, measured = _matches(frame, lost.anchors, warps, least_correlation)
        points = points_in_start(camera, lost.sights)[landmark]
        T = pose_of_matches(camera, points, measured, LEAST)
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
    points = points_in_start(camera, lost.sights)[i]
    return fitted_pose(camera, frame.T_start_cam, points, frame.sights.measured[j])


def _matches(
    frame: Frame, anchors: Anchors, warps: Array, least_correlation: float
) -> tuple[Index, Array]:
    """Match anchors under their warps (N, 3, 2) with a frame around its features.

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
    side, upright = frame.left_image.patch_size, np.tile(UPRIGHT, (len(frame.left), 1, 1))
    seen = warped_patches(Anchors.of_image(frame.left_image, frame.sights), upright, side)
    known = warped_patches(anchors, warps, side)
    alike = _normalised(known) @ _normalised(seen).T
    best = np.argsort(-alike.T, axis=1, kind="stable")[:, :CANDIDATES]
    return best.ravel(), np.repeat(np.arange(len(frame.left)), best.shape[1])


def _normalised(patches: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of the cells of patches (N, side, side), without their mean and of length 1."""
    count, cells = len(patches), patches.shape[1] // CELL
    whole = patches[:, : cells * CELL, : cells * CELL].reshape(count, cells, CELL, cells, CELL)
    means = whole.mean(axis=(2, 4)).reshape(count, cells**2)
    means -= means.mean(axis=1, keepdims=True)
    return means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), np.float32(1e-6))
