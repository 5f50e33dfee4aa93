"""The stage at which landmarks are lost, if they are: what was seen there, and what would help."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gpvo.cluster_report import ClusterReport

FEW_EVENTS = 500
"""Median number of events per cluster and camera below which a picture shows next to nothing."""
FEW_LANDMARKS = 12
"""Median number of features, matches or tracklets per cluster below which they are few."""
SAME_VIEW = (
    "is the calibration that of these cameras, are left and right swapped, are their clocks apart"
)
EARLY = 1.0
"""Time after which a stream without inliers is not just beginning, seconds."""


def is_lost(reports: Sequence[ClusterReport]) -> bool:
    """Return whether most clusters have hardly any inliers, although something moves."""
    return 2 * len(_lost(reports)) > len(reports)


def lost_stage(reports: Sequence[ClusterReport]) -> str:
    """Find the first stage of clusters with few inliers that has little left; say it in one line.

    The numbers are medians over these clusters.
    """
    lost = _lost(reports)
    if not lost:
        return _nothing_lost(reports)
    stages = _stages(lost)
    first = next((stage for stage in stages if stage.is_few), stages[-1])
    seen = ", ".join(stage.seen for stage in stages[: stages.index(first) + 1])
    return (
        f"{len(lost)} of {len(reports)} clusters of events have hardly any inliers; per cluster"
        f" (median): {seen}; {first.advice}"
    )


def _nothing_lost(reports: Sequence[ClusterReport]) -> str:
    """Say what was seen where no cluster lost landmarks: a camera at rest, or too few clusters."""
    still = sum(report.at_rest for report in reports)
    if not still:
        return f"{len(reports)} clusters of events; is the recording long enough?"
    return (
        f"in {still} of {len(reports)} clusters of events nothing moved: they hold few events, or"
        " as even ones over the sensor as noise; does the camera move, is its lens uncovered?"
    )


def _lost(reports: Sequence[ClusterReport]) -> list[ClusterReport]:
    return [report for report in reports if report.hardly_measures]


class _Stage(NamedTuple):
    """What one stage left in the median cluster, and what helps if it is too little."""

    seen: str
    is_few: bool
    advice: str


def _stages(lost: Sequence[ClusterReport]) -> list[_Stage]:
    """Return the stages in the order of the flow."""
    return [_events(lost), *_tracking(lost), *_tracklets(lost)]


def _events(lost: Sequence[ClusterReport]) -> _Stage:
    left, right = _median([(report.left_events, report.right_events) for report in lost])
    background, hot = _median([report.left_out for report in lost])
    seen = f"{left} left and {right} right events"
    if background + hot > 0:
        seen += f" after {background} of background activity and {hot} of hot pixels left out"
    advice = "more events are needed: does the camera move, is there light and texture,"
    advice += " do both cameras work, are their contrast thresholds too high?"
    return _Stage(seen, min(left, right) < FEW_EVENTS, advice)


def _tracking(lost: Sequence[ClusterReport]) -> list[_Stage]:
    found = [report.tracking for report in lost if report.tracking is not None]
    if not found:
        return []
    features, stereo, known, closed = _median(
        [(each.features, each.stereo, each.known, each.closed) for each in found]
    )
    return [
        _Stage(
            f"{features} new features and {known} known ones",
            features + known < FEW_LANDMARKS,
            "more contours are needed: is the lens in focus, is there texture?",
        ),
        _Stage(
            f"{stereo} of the new ones matched in the right picture",
            stereo + closed < FEW_LANDMARKS,
            f"the cameras must see the same at the same time: {SAME_VIEW}, is most of it noise?",
        ),
        _Stage(
            f"{closed} of the known ones followed from the cluster before",
            closed < FEW_LANDMARKS,
            "clusters must be alike: is most of it noise or flicker, is the motion so fast that"
            " a smaller clustering.motion or clustering.window is needed?",
        ),
    ]


def _tracklets(lost: Sequence[ClusterReport]) -> list[_Stage]:
    observations, out_of_bounds, too_short, tracklets, inliers = _median(
        [(r.observations, r.out_of_bounds, r.too_short, r.tracklets, r.inliers) for r in lost]
    )
    return [
        _Stage(
            f"{observations} observations",
            observations < FEW_LANDMARKS,
            "the tracker must find more",
        ),
        _Stage(
            f"{out_of_bounds} of them with left and right events too far apart in time or too"
            " small a disparity",
            observations - out_of_bounds < FEW_LANDMARKS,
            "are the cameras' clocks apart, is all of the scene too far away for the baseline?"
            " see tracklets.max_stereo_time_difference and tracklets.min_disparity",
        ),
        _Stage(
            f"{too_short} tracklets too short and {tracklets} long enough",
            tracklets < FEW_LANDMARKS,
            "landmarks must be seen longer: see tracklets.min_length, tracklets.min_duration and"
            " tracklets.history",
        ),
        _Stage(
            f"{inliers} that agree on one velocity",
            True,
            f"{SAME_VIEW}, do other things than the camera move, are mc_ransac.relative_threshold"
            " and mc_ransac.pixel_threshold below the noise of the tracks?",
        ),
    ]


def _median(rows: Sequence[tuple[int, ...]]) -> list[int]:
    """Return the median of each column of rows, rounded."""
    return [round(value) for value in np.median(np.array(rows, np.float64), axis=0).tolist()]
