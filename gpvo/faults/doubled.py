"""Events that come twice, with the same pixel and the same time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpvo.faults.fault import Fault
from gpvo.recordings import Events, StereoEvents

SAMPLE = 400
"""Events of each batch that are looked at."""
ENOUGH, LAST = 4000, 100_000
"""Number of events from which, and up to which, the share of repeated ones is judged."""
OFTEN = 0.2
"""Share of repeated events that no sensor has: a pixel is silent for a while after an event."""


class DoubledEvents:
    """Counts repeated events in samples of the stream."""

    def __init__(self) -> None:
        self._seen = {"left": 0, "right": 0}
        self._again = {"left": 0, "right": 0}

    def see(self, batch: StereoEvents) -> Iterator[Fault]:
        """Look at the next events; yield what is wrong."""
        for side, events in (("left", batch.left), ("right", batch.right)):
            if self._seen[side] >= LAST:
                continue
            sample = events[:SAMPLE]
            self._seen[side] += len(sample)
            self._again[side] += repeated(sample)
            if self._seen[side] < ENOUGH:
                continue
            share = self._again[side] / self._seen[side]
            if share >= OFTEN:
                yield Fault(
                    "doubled events",
                    batch.start,
                    f"{share:.0%} of the {side} camera's events come twice: is its topic recorded"
                    " or played twice?",
                    harms=False,
                    numbers={"share": share},
                )


def repeated(events: Events) -> int:
    """Count the events that repeat the pixel and the time of another, each pair as two."""
    key = np.rint(events.t * 1e9).astype(np.int64) * 65_537 + events.x
    _, count = np.unique(key * 65_537 + events.y, return_counts=True)
    return int(count[count > 1].sum())
