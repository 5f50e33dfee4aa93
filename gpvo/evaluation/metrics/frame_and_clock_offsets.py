"""Constant offsets between the clocks and the body frames of estimate and ground truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.evaluation.metrics.alignment import nearest_rotation, umeyama_alignment
from gpvo.evaluation.metrics.association import interval_text, require_associated
from gpvo.evaluation.metrics.ate_rpe import relative_motions, rotation_angles
from gpvo.trajectory import StampedPoses

SAMPLE_NS = 5_000_000
"""Sampling interval of motions for the time offset, nanoseconds."""

LEAST_TURNING = 0.05
"""Smallest RMS rotation of a direction, rad, for which a lever arm along it is observable."""


def find_time_offset(
    estimate: StampedPoses, ground_truth: StampedPoses, max_offset: float = 0.1
) -> float:
    """Find the offset between the clocks: seconds to add to the estimate's stamps.

    It maximises the correlation of the norms of rotation and translation over a short time. The
    norms do not depend on the world frame, and their correlation does not depend on scale.

    Raises
    ------
    InputError
        If they have less than a second in common, or no offset within `max_offset` fits best.
    """
    if not 0.0 < max_offset < np.inf:
        raise InputError(f"max_offset {max_offset}: must be a positive, finite number of seconds")
    span_ns = _span(estimate, ground_truth)
    stamps, true_sizes = _motion_sizes(ground_truth, span_ns)
    own_stamps, sizes = _motion_sizes(estimate, span_ns)
    origin = int(stamps[0])
    seconds, own_seconds = (stamps - origin) * 1e-9, (own_stamps - origin) * 1e-9
    inside = (seconds > own_seconds[0] + max_offset) & (seconds < own_seconds[-1] - max_offset)
    if np.count_nonzero(inside) * SAMPLE_NS < 1_000_000_000:
        raise InputError(
            "too little in common for a time offset: the estimate covers"
            f" {interval_text(estimate)} and the ground truth {interval_text(ground_truth)}"
        )

    def mismatch(offset: float) -> float:
        shifted = [np.interp(seconds[inside] - offset, own_seconds, size) for size in sizes]
        pairs = zip(shifted, (size[inside] for size in true_sizes), strict=True)
        return -sum(_correlation(one, other) for one, other in pairs)

    coarse = np.arange(-max_offset, max_offset + 0.0025, 0.005)
    best = int(np.argmin([mismatch(offset) for offset in coarse]))
    if best in (0, len(coarse) - 1):
        raise InputError(f"no clear time offset within {max_offset} s")
    bounds = (coarse[best - 1], coarse[best + 1])
    return float(minimize_scalar(mismatch, bounds=bounds, options={"xatol": 1e-6}).x)


def _span(estimate: StampedPoses, ground_truth: StampedPoses) -> int:
    """Return 0.1 s or two intervals of the sparser trajectory, in ns; an even number of samples."""
    for poses in (estimate, ground_truth):
        _require_time(poses, len(poses) > 1)
    interval = max(np.median(np.diff(poses.stamps_ns)) for poses in (estimate, ground_truth))
    return 2 * SAMPLE_NS * round(max(100_000_000, 2 * interval) / (2 * SAMPLE_NS))


def _require_time(poses: StampedPoses, is_long: bool) -> None:
    if not is_long:
        raise InputError(f"a trajectory of {interval_text(poses)} is too short for a time offset")


def _motion_sizes(
    poses: StampedPoses, span_ns: int
) -> tuple[NDArray[np.int64], tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return middle stamps, rotation angles and translation norms of steps of `span_ns`."""
    stamps = np.arange(poses.stamps_ns[0], poses.stamps_ns[-1] + 1, SAMPLE_NS)
    span = span_ns // SAMPLE_NS
    _require_time(poses, len(stamps) > span)
    first = np.arange(len(stamps) - span)
    motions = relative_motions(poses.interpolate(stamps), first, first + span)
    sizes = (rotation_angles(motions), np.linalg.norm(motions[:, :3, 3], axis=1))
    return stamps[first] + span_ns // 2, sizes


def _correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Compute Pearson's correlation coefficient; zero if one series is constant."""
    one, other = one - one.mean(), other - other.mean()
    norm = np.linalg.norm(one) * np.linalg.norm(other)
    return float(one @ other / norm) if norm > 0.0 else 0.0


def find_body_offset(
    estimate: StampedPoses, ground_truth: StampedPoses, lever_arm: bool = False
) -> NDArray[np.float64]:
    """Find the constant transform T_truth_estimate (4, 4) between the two compared bodies.

    The worlds are aligned by least squares over the positions, without scale. The mean of the
    remaining rotations is the rotation between the bodies.

    Parameters
    ----------
    estimate, ground_truth
        Poses with the same stamps, or associated, N each.
    lever_arm
        Fit the translation between the bodies too, jointly with the alignment of the worlds, in
        the directions that rotation makes observable. Otherwise the bodies share their origin.
    """
    require_associated(estimate, ground_truth)
    R_truth_world = umeyama_alignment(estimate.positions, ground_truth.positions).rotation
    offset = np.eye(4)
    if lever_arm:
        R_truth_world, offset[:3, 3] = _lever_arm(estimate, ground_truth, R_truth_world)
    turns = np.swapaxes(ground_truth.rotations, 1, 2) @ R_truth_world @ estimate.rotations
    offset[:3, :3] = nearest_rotation(turns.sum(axis=0))
    return offset


def _lever_arm(
    estimate: StampedPoses, ground_truth: StampedPoses, R_truth_world: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find world rotation R and lever arm p with the least spread of R x_k - (y_k + R_k p)."""
    turning = ground_truth.rotations - ground_truth.rotations.mean(axis=0)
    weights, directions = np.linalg.eigh(np.mean(np.swapaxes(turning, 1, 2) @ turning, axis=0))
    shown = directions[:, weights > LEAST_TURNING**2]
    points = estimate.positions - estimate.positions.mean(axis=0)
    targets = ground_truth.positions - ground_truth.positions.mean(axis=0)

    def spread(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        rotation = Rotation.from_rotvec(parameters[:3]).as_matrix() @ R_truth_world
        return (points @ rotation.T - targets - turning @ (shown @ parameters[3:])).ravel()

    best = least_squares(spread, np.zeros(3 + shown.shape[1])).x
    return Rotation.from_rotvec(best[:3]).as_matrix() @ R_truth_world, shown @ best[3:]
