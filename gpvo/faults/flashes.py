"""What the filters leave out of a cluster, where it is much."""

from __future__ import annotations

from collections.abc import Iterator

from gpvo.cluster_report import ClusterReport
from gpvo.faults.fault import Fault

MUCH = 0.05
"""Share of a cluster's events that is worth a word."""


def leaves_out(report: ClusterReport) -> Iterator[Fault]:
    """Yield what was left out before and in a cluster."""
    if report.flash > 0:
        yield Fault(
            "burst",
            report.start - report.flash,
            f"a burst of events at all pixels, of {1000 * report.flash:.0f} ms, is left out: does"
            " a lamp flash or flicker, does the camera's supply fail?",
            harms=False,
            numbers={"duration_s": report.flash},
        )
    hot, count = report.left_out[1], report.events + sum(report.left_out)
    if hot > MUCH * count and hot > 100:
        share = hot / count
        yield Fault(
            "hot pixels",
            report.start,
            f"{share:.0%} of the events are of hot pixels and left out; mask these in the driver",
            harms=False,
            numbers={"share": share},
        )
