"""Latency: from the arrival of a cluster's last events to the estimate that contains them."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray


class Latency:
    """Latencies of clusters, seconds; the cluster's own length is not in them.

    Attributes
    ----------
    seconds
        One for each cluster so far.
    """

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self._arrivals: deque[tuple[int, float]] = deque()

    def arrived(self, first_ns: int, arrival: float) -> None:
        """Note the arrival of a packet whose first event has this stamp."""
        self._arrivals.append((first_ns, arrival))

    def estimated(self, stop_ns: int, now: float) -> None:
        """Note the estimate of a cluster that ended at this stamp."""
        arrival = None
        while self._arrivals and self._arrivals[0][0] < stop_ns:
            arrival = self._arrivals.popleft()
        if arrival is not None:
            self.seconds.append(now - arrival[1])
            # The next cluster may end within the same packet.
            self._arrivals.appendleft(arrival)

    @property
    def newest(self) -> float:
        """Latency of the newest estimate, seconds; 0 before the first."""
        return self.seconds[-1] if self.seconds else 0.0

    def percentiles(self) -> NDArray[np.float64]:
        """Return the median, 95 % and 99 %, seconds; NaN without clusters."""
        if not self.seconds:
            return np.full(3, np.nan)
        return np.percentile(self.seconds, (50, 95, 99))
