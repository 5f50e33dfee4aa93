"""Association of poses by time, and the common time of two trajectories."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpvo.errors import InputError
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import gaps_of, seconds_text


def associate(
    estimate: StampedPoses, ground_truth: StampedPoses, max_difference: float = 0.02
) -> tuple[StampedPoses, StampedPoses]:
    """Pair every pose of the shorter trajectory with the nearest pose in time of the longer one.

    Parameters
    ----------
    estimate, ground_truth
        Trajectories on the same clock.
    max_difference
        Largest difference between the two stamps of a pair, seconds.

    Returns
    -------
    Associated poses of the estimate and of the ground truth, N each, both with the stamps of the
    shorter trajectory.

    Raises
    ------
    InputError
        If fewer than two pairs are within `max_difference`.
    """
    truth_is_shorter = len(ground_truth) <= len(estimate)
    short, long = (ground_truth, estimate) if truth_is_shorter else (estimate, ground_truth)
    nearest = nearest_indices(short.stamps_ns, long.stamps_ns)
    difference_ns = np.abs(long.stamps_ns[nearest] - short.stamps_ns)
    close = difference_ns <= round(max_difference * 1e9)
    if np.count_nonzero(close) < 2:
        raise InputError(
            f"no poses within {max_difference} s of each other: the estimate covers"
            f" {interval_text(estimate)} and the ground truth {interval_text(ground_truth)};"
            " check that both use the same clock"
        )
    chosen_short = short[close]
    chosen_long = StampedPoses(chosen_short.stamps_ns, long.T_world_cam[nearest[close]])
    return (chosen_long, chosen_short) if truth_is_shorter else (chosen_short, chosen_long)


def require_associated(*series: StampedPoses) -> None:
    """Raise InputError unless all have as many poses, at least one."""
    counts = [len(poses) for poses in series]
    if 0 in counts or len(set(counts)) > 1:
        raise InputError(
            f"{' and '.join(map(str, counts))} poses cannot be compared one by one; interpolate"
            " them at the same stamps, or associate them"
        )


def nearest_indices(stamps: NDArray[np.int64], among: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the indices of the nearest stamps in increasing `among`; of a tie the earlier one."""
    above = np.clip(np.searchsorted(among, stamps), 0, len(among) - 1)
    below = np.maximum(above - 1, 0)
    return np.where(stamps - among[below] <= among[above] - stamps, below, above)


def resample(
    estimate: StampedPoses, ground_truth: StampedPoses
) -> tuple[StampedPoses, StampedPoses]:
    """Interpolate the denser trajectory at the stamps of the sparser one (fewer poses)."""
    sparser = min(ground_truth, estimate, key=len)
    stamps = common_part(sparser.stamps_ns, estimate, ground_truth)
    return estimate.interpolate(stamps), ground_truth.interpolate(stamps)


def tolerance_for(ground_truth: StampedPoses) -> float:
    """Return the association tolerance, seconds: 0.02, or 0.3 intervals of a sparse truth."""
    return max(0.02, 0.3e-9 * float(np.median(np.diff(ground_truth.stamps_ns))))


def common_part(
    stamps_ns: ArrayLike, estimate: StampedPoses, ground_truth: StampedPoses
) -> NDArray[np.int64]:
    """Return the stamps within the common time; InputError if there are fewer than two.

    Those in gaps of either trajectory are left out, as its poses are unknown there.
    """
    stamps = np.asarray(stamps_ns, np.int64)
    start, stop = common_interval(estimate, ground_truth)
    inside = stamps[(stamps >= start) & (stamps <= stop)]
    for poses in (estimate, ground_truth):
        inside = inside[~_within(inside, poses.gaps_ns)]
    if len(inside) < 2:
        raise InputError(
            f"nothing to compare: the estimate covers {interval_text(estimate)} and the ground"
            f" truth {interval_text(ground_truth)}, with less than two stamps to compare at in"
            " common; check that both use the same clock, or take a shorter step"
        )
    return inside


def _within(stamps: NDArray[np.int64], gaps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which stamps (N,) are within gaps (G, 2), without their ends."""
    if len(gaps_ns) == 0:
        return np.zeros(len(stamps), bool)
    gap = np.searchsorted(gaps_ns[:, 0], stamps) - 1
    return np.asarray((gap >= 0) & (stamps < gaps_ns[gap, 1]))


def known_ns(stamps_ns: NDArray[np.int64]) -> int:
    """Return the time from the first stamp to the last one without gaps, nanoseconds."""
    return int(stamps_ns[-1] - stamps_ns[0] - np.diff(gaps_of(stamps_ns)).sum())


def common_interval(estimate: StampedPoses, ground_truth: StampedPoses) -> tuple[int, int]:
    """Return the first and last stamp of the common time, nanoseconds."""
    if not (len(estimate) and len(ground_truth)):
        raise InputError(
            f"nothing to compare: the estimate covers {interval_text(estimate)} and the ground"
            f" truth {interval_text(ground_truth)}"
        )
    start = max(estimate.stamps_ns[0], ground_truth.stamps_ns[0])
    stop = min(estimate.stamps_ns[-1], ground_truth.stamps_ns[-1])
    return int(start), int(stop)


def interval_text(poses: StampedPoses) -> str:
    """Format the first and last stamp for error messages."""
    if len(poses) == 0:
        return "no time"
    return f"{seconds_text(poses.stamps_ns[0])} to {seconds_text(poses.stamps_ns[-1])} s"
