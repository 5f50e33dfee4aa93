"""Landmarks that move otherwise than the camera, where they are many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gpvo.cluster_report import ClusterReport
from gpvo.faults.fault import Fault
from gpvo.faults.rates import latest

PERIOD = 1.0
"""Seconds over which they are counted."""
MANY = 0.2
"""Share of the tracklets that are outliers where something moves by itself.

On simulated recordings of all kinds at most 7 % are, where nothing does.
"""
ENOUGH = 200
"""Number of tracklets in the period from which the share is told."""


def many_outliers(reports: Sequence[ClusterReport]) -> Iterator[Fault]:
    """Count the outliers of the latest clusters of which the velocity is known."""
    clusters = [report for report in latest(reports, PERIOD) if not report.hardly_measures]
    tracklets = sum(report.tracklets for report in clusters)
    inliers = sum(report.inliers for report in clusters)
    if tracklets < ENOUGH or inliers > (1 - MANY) * tracklets:
        return
    share = 1 - inliers / tracklets
    yield Fault(
        "many outliers",
        reports[-1].stop - PERIOD,
        f"{share:.0%} of the landmarks move otherwise than MC-RANSAC's velocity says: does"
        " something move by itself in view, are thresholds of mc_ransac below the noise of the"
        " tracks? The path may be that of what most landmarks are on",
        numbers={"share": share},
    )
