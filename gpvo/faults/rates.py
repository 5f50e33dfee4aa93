"""Event rates of both cameras: their course in milliseconds, and how they compare."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gpvo.cluster_report import ClusterReport
from gpvo.faults.fault import Fault
from gpvo.recordings import Events, StereoEvents

REMEMBERED = 4000
"""Milliseconds of which the rates are known."""
PERIOD = 1.0
"""Seconds over which the cameras' numbers of events are compared."""
DIFFERENT = 0.5
"""Ratio of the cameras' rates below which one of them loses events."""
ENOUGH = 2000
"""Number of events in the period from which rates are compared."""


class EventRates:
    """Numbers of events of both cameras in every one of the latest milliseconds.

    Attributes
    ----------
    counts
        (2, M) of left and right camera, the newest last; the newest millisecond may be incomplete.
    stop
        Where the newest millisecond ends, milliseconds since the recording's start.
    seconds, events
        Time seen so far, and the numbers of events (2,) in it.
    """

    def __init__(self) -> None:
        self.counts = np.zeros((2, 0), np.int64)
        self.stop = 0
        self.seconds, self.events = 0.0, np.zeros(2, np.int64)

    def add(self, batch: StereoEvents) -> None:
        """Count the next events of the stream."""
        self.seconds += batch.stop - batch.start
        self.events += [len(batch.left), len(batch.right)]
        first, stop = int(batch.start * 1000), int(np.ceil(batch.stop * 1000))
        if self.counts.shape[1] == 0 or first - self.stop > REMEMBERED:
            self.counts, self.stop = np.zeros((2, 0), np.int64), first
        more = max(stop - self.stop, 0)
        self.counts = np.pad(self.counts, ((0, 0), (0, more)))[:, -REMEMBERED:]
        self.stop += more
        first = max(first, self.stop - self.counts.shape[1])
        place = first - self.stop + self.counts.shape[1]
        for row, events in zip(self.counts, (batch.left, batch.right), strict=True):
            row[place : place + stop - first] += per_millisecond(events, first, stop)


def per_millisecond(events: Events, first: int, stop: int) -> NDArray[np.int64]:
    """Count the events of the milliseconds from `first` to before `stop`, all that there are."""
    inside = np.searchsorted(events.t, np.arange(first + 1, stop) / 1000)
    return np.asarray(np.diff(inside, prepend=0, append=len(events)), np.int64)


def different_rates(reports: Sequence[ClusterReport]) -> Iterator[Fault]:
    """Compare the cameras' events of the latest clusters, without noise and hot pixels."""
    stop = reports[-1].stop
    if reports[0].start > stop - PERIOD:
        return
    left = right = 0
    for report in reversed(reports):
        if report.start < stop - PERIOD:
            break
        left, right = left + report.left_events, right + report.right_events
    few, many = sorted((left, right))
    if many < ENOUGH or few == 0 or few >= DIFFERENT * many:
        return
    side, other = ("right", "left") if right < left else ("left", "right")
    yield Fault(
        "different rates",
        stop - PERIOD,
        f"the {side} camera has {few / many:.0%} of the {other} one's events: does it lose packets"
        " (USB, disk, network), are its thresholds, aperture or focus different?",
        numbers={"left_events_per_s": left / PERIOD, "right_events_per_s": right / PERIOD},
    )
