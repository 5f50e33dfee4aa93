"""Whether no event came because nothing moved, or because data is missing.

A camera slows down before it rests, so that its events fade out. A stream that ends among many
events was cut.
"""

from __future__ import annotations

from collections import deque
from statistics import median

import numpy as np

from gpvo.events import StereoCluster
from gpvo.tracking.contour_way import USUAL

END = 0.003
"""A stream ends in so many seconds before its last event."""
FADED = 0.02
"""Share of the usual number of events from which on it was cut.

At constant deceleration to rest, within T seconds, there is a share of END / 2T: 0.015 for 0.1.
"""


class MissingData:
    """Tells of each cluster whether data is missing: no event came, and those before were cut."""

    def __init__(self) -> None:
        self._rates, self._was_cut = deque[float](maxlen=USUAL), True

    def is_in(self, cluster: StereoCluster) -> bool:
        """Return whether data is missing in the next cluster."""
        if cluster.event_count == 0:  # but noise that was left out may have come
            return cluster.is_silent and self._was_cut
        self._rates.append(cluster.event_count / (cluster.stop - cluster.start))
        self._was_cut = events_at_end(cluster) > FADED * END * median(self._rates)
        return False


def events_at_end(cluster: StereoCluster) -> int:
    """Count the events of both cameras in the last moment, before the last of them."""
    sides = (cluster.left, cluster.right)
    t = [part.t for side in sides for part in side.parts if len(part)]
    begin = max(times[-1] for times in t) - END
    return sum(len(times) - int(np.searchsorted(times, begin)) for times in t) - 1
