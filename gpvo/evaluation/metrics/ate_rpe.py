"""evo-style absolute trajectory error (ATE) and relative pose error (RPE).

Definitions of J. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from factors.lie import se3_inverse
from gpvo.errors import InputError, require_choice
from gpvo.evaluation.metrics.alignment import Alignment, AlignmentMethod, find_alignment
from gpvo.evaluation.metrics.association import require_associated
from gpvo.evaluation.metrics.statistics import Statistics
from gpvo.trajectory import StampedPoses

DeltaUnit = Literal["frames", "seconds", "metres"]
Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True)
class TrajectoryError:
    """Translation error in metres and rotation error in radians."""

    translation: Statistics
    rotation: Statistics
    scale: float = 1.0

    @staticmethod
    def of(T_error: NDArray[np.float64], scale: float = 1.0) -> TrajectoryError:
        """Summarise error transforms (N, 4, 4)."""
        distances = np.linalg.norm(T_error[:, :3, 3], axis=1)
        return TrajectoryError(
            Statistics.of(distances), Statistics.of(rotation_angles(T_error)), scale
        )


def rotation_angles(transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation angles (N,) of transforms (N, 4, 4), radians."""
    if len(transforms) == 0:
        return np.empty(0)
    return Rotation.from_matrix(transforms[:, :3, :3]).magnitude()


def absolute_trajectory_error(
    estimate: StampedPoses,
    ground_truth: StampedPoses,
    alignment: AlignmentMethod | Alignment = "se3",
) -> TrajectoryError:
    """Compute the absolute trajectory error (ATE) of the aligned estimate.

    Parameters
    ----------
    estimate, ground_truth
        Poses with the same stamps, or associated, N each.
    alignment
        Method of `find_alignment`, or an alignment found before.

    Raises
    ------
    InputError
        If the numbers of poses differ or are zero.
    """
    require_associated(estimate, ground_truth)
    if not isinstance(alignment, Alignment):
        alignment = find_alignment(estimate, ground_truth, alignment)
    aligned = alignment.apply(estimate)
    T_error = se3_inverse(ground_truth.T_world_cam) @ aligned.T_world_cam
    return TrajectoryError.of(T_error, alignment.scale)


def relative_pose_error(
    estimate: StampedPoses,
    ground_truth: StampedPoses,
    delta: float = 1.0,
    unit: DeltaUnit = "frames",
    all_pairs: bool = True,
    pairs_from: StampedPoses | None = None,
) -> TrajectoryError:
    """Compute the relative pose error (RPE): the estimated against the true motion over a distance.

    Parameters
    ----------
    estimate, ground_truth
        Poses with the same stamps, or associated, N each.
    delta, unit
        Distance in frames, seconds or metres along the path.
    all_pairs
        Whether overlapping pairs start at every pose, or each pair where the previous one ends.
    pairs_from
        Trajectory whose stamps and path choose the pairs, the ground truth by default.

    Raises
    ------
    InputError
        If the numbers of poses differ or are zero, or the distance is none.
    """
    pairs_from = ground_truth if pairs_from is None else pairs_from
    require_associated(estimate, ground_truth, pairs_from)
    first, last = pose_pairs(pairs_from, delta, unit, all_pairs)
    motion = relative_motions(estimate, first, last)
    true_motion = relative_motions(ground_truth, first, last)
    return TrajectoryError.of(se3_inverse(true_motion) @ motion)


def relative_motions(
    poses: StampedPoses, first: NDArray[np.intp], last: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return the transforms T_first_last (M, 4, 4) of pairs of poses."""
    return se3_inverse(poses.T_world_cam[first]) @ poses.T_world_cam[last]


def pose_pairs(poses: StampedPoses, delta: float, unit: DeltaUnit, all_pairs: bool) -> Pairs:
    """Return the indices of the first and last pose of every pair that is `delta` apart.

    Overlapping pairs may differ from `delta` by a tenth (frames: not at all); chained ones take
    the first pose that is at least `delta` away.
    """
    if not 0.0 < delta < np.inf or (unit == "frames" and delta % 1.0):
        raise InputError(
            f"RPE over {delta} {unit}: needs a positive, finite (for frames: whole) number"
        )
    progress = pose_progress(poses, unit)
    if all_pairs:
        return _overlapping_pairs(progress, delta, 0.0 if unit == "frames" else 0.1 * delta)
    return _chained_pairs(progress, delta)


def pose_progress(poses: StampedPoses, unit: DeltaUnit) -> NDArray[np.float64]:
    """Return the distance (N,) from the first pose in frames, seconds or metres along the path."""
    require_choice("unit", unit, DeltaUnit)
    if unit == "frames":
        return np.arange(len(poses), dtype=np.float64)
    if unit == "seconds":
        return poses.seconds
    path_steps = np.linalg.norm(np.diff(poses.positions, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(path_steps)])


def _overlapping_pairs(progress: NDArray[np.float64], delta: float, tolerance: float) -> Pairs:
    """Pair every pose with the later one nearest to `delta` ahead, if within the tolerance."""
    first = np.arange(len(progress) - 1)
    wanted = progress[first] + delta
    above = np.clip(np.searchsorted(progress, wanted), first + 1, len(progress) - 1)
    # At rest several poses have the same progress; the first of them counts.
    below = np.searchsorted(progress, progress[np.maximum(above - 1, 0)])
    below = np.maximum(below, first + 1)
    last = np.where(wanted - progress[below] <= progress[above] - wanted, below, above)
    close = np.abs(progress[last] - wanted) <= tolerance
    return first[close], last[close]


def _chained_pairs(progress: NDArray[np.float64], delta: float) -> Pairs:
    """Pair every chosen pose with the first one at least `delta` ahead, which is chosen next."""
    chosen = [0]
    tolerance = 1e-9 * delta  # 3 * 0.1 is not exactly 0.3
    while True:
        following = int(np.searchsorted(progress, progress[chosen[-1]] + delta - tolerance))
        if following >= len(progress):
            return np.array(chosen[:-1], np.intp), np.array(chosen[1:], np.intp)
        chosen.append(following)
