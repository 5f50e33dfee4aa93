"""Which pose belongs to which, by time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.poses import StampedPoses, seconds_text


def associate(
    estimate: StampedPoses, ground_truth: StampedPoses, max_difference: float = 0.02
) -> tuple[StampedPoses, StampedPoses]:
    """Pair every pose of the shorter trajectory with the nearest in time of the longer one.

    Parameters
    ----------
    estimate, ground_truth
        Trajectories on the same clock.
    max_difference
        Seconds that the two stamps of a pair may differ.

    Returns
    -------
    As many poses of the estimate as of the ground truth, taken as simultaneous: both carry the
    shorter trajectory's stamps.

    Raises
    ------
    InputError
        If less than two pairs are that near.
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


def nearest_indices(stamps: NDArray[np.int64], among: NDArray[np.int64]) -> NDArray[np.intp]:
    """Index into `among` (increasing) of the stamp nearest to each; the earlier one of a tie."""
    above = np.clip(np.searchsorted(among, stamps), 0, len(among) - 1)
    below = np.maximum(above - 1, 0)
    return np.where(stamps - among[below] <= among[above] - stamps, below, above)


def interval_text(poses: StampedPoses) -> str:
    """First and last stamp in words, for error messages."""
    return f"{seconds_text(poses.stamps_ns[0])} to {seconds_text(poses.stamps_ns[-1])} s"
