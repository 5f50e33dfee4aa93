"""How the cameras' numbers of events compare."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import takewhile

from gpvo.cluster_report import ClusterReport
from gpvo.faults.fault import Fault

PERIOD = 1.0
"""Seconds over which the cameras' numbers of events are compared."""
DIFFERENT = 0.5
"""Ratio of the cameras' rates below which one of them loses events."""
ENOUGH = 2000
"""Number of events in the period from which rates are compared."""


def latest(reports: Sequence[ClusterReport], period: float) -> list[ClusterReport]:
    """Return the clusters that began in the last so many seconds; none before these are over."""
    begin = reports[-1].stop - period
    if reports[0].start > begin:
        return []
    return list(takewhile(lambda report: report.start >= begin, reversed(reports)))


def different_rates(reports: Sequence[ClusterReport]) -> Iterator[Fault]:
    """Compare the cameras' events of the latest clusters, without noise and hot pixels."""
    clusters = latest(reports, PERIOD)
    left = sum(report.left_events for report in clusters)
    right = sum(report.right_events for report in clusters)
    few, many = sorted((left, right))
    if many < ENOUGH or few == 0 or few >= DIFFERENT * many:
        return
    side, other = ("right", "left") if right < left else ("left", "right")
    yield Fault(
        "different rates",
        reports[-1].stop - PERIOD,
        f"the {side} camera has {few / many:.0%} of the {other} one's events: does it lose packets"
        " (USB, disk, network), are its thresholds, aperture or focus different?",
        numbers={"left_events_per_s": left / PERIOD, "right_events_per_s": right / PERIOD},
    )
