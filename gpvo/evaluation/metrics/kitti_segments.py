"""KITTI-style segment errors: drift over stretches of the path, per metre travelled.

Source: the development kit of A. Geiger, P. Lenz and R. Urtasun, "Are we ready for autonomous
driving? The KITTI vision benchmark suite", CVPR 2012.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_inverse
from gpvo.evaluation.metrics.ate_rpe import pose_progress, relative_motions, rotation_angles
from gpvo.trajectory import StampedPoses

KITTI_LENGTHS = tuple(range(100, 900, 100))
"""Segment lengths for cars, metres."""

PATH_PARTS = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Segment lengths as fractions of a path that is too short for KITTI's lengths."""


@dataclass(frozen=True)
class SegmentError:
    """Mean error of all segments of one length (metres)."""

    length: float
    translation_percent: float
    rotation_deg_per_m: float
    count: int


def segment_errors(
    estimate: StampedPoses,
    ground_truth: StampedPoses,
    lengths: Sequence[float] | None = None,
    start_every: int = 10,
) -> list[SegmentError]:
    """Compute the mean drift over segments of the ground truth's path.

    Parameters
    ----------
    estimate, ground_truth
        Poses with the same stamps, or associated, N each.
    lengths
        Segment lengths, metres; by default KITTI's for paths longer than 800 m, or else tenths of
        the path.
    start_every
        Number of poses from the start of one segment to the next; 10 in KITTI.

    Returns
    -------
    One entry for each length that fits into the path.
    """
    progress = pose_progress(ground_truth, "metres")
    if lengths is None:
        fits = progress[-1] > KITTI_LENGTHS[-1]
        lengths = KITTI_LENGTHS if fits else tuple(part * progress[-1] for part in PATH_PARTS)
    errors = []
    for length in lengths:
        first, last = _segments(progress, length, start_every)
        if len(first):
            errors.append(_mean_error(estimate, ground_truth, first, last, length))
    return errors


def _segments(
    progress: NDArray[np.float64], length: float, start_every: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first pose of every segment and the first one more than `length` ahead."""
    first = np.arange(0, len(progress), start_every)
    last = np.searchsorted(progress, progress[first] + length, side="right")
    inside = last < len(progress)
    return first[inside], last[inside]


def _mean_error(
    estimate: StampedPoses,
    ground_truth: StampedPoses,
    first: NDArray[np.intp],
    last: NDArray[np.intp],
    length: float,
) -> SegmentError:
    true_motion = relative_motions(ground_truth, first, last)
    T_error = se3_inverse(relative_motions(estimate, first, last)) @ true_motion
    distances = np.linalg.norm(T_error[:, :3, 3], axis=1)
    return SegmentError(
        length=float(length),
        translation_percent=float(100.0 * distances.mean() / length),
        rotation_deg_per_m=float(np.degrees(rotation_angles(T_error).mean()) / length),
        count=len(first),
    )
