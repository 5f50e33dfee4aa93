"""How uneven the events of a cluster are over the sensor: noise is even, contours are not.

With n events in each of many blocks of pixels, (var n - chance) / (mean n)^2 is the squared
coefficient of variation of their rates: about 0 for noise, 0.3 and more for the contours of a
scene, whatever share of their events is left. By chance var n is mean n, or mean n (1 - n / B)
where n of B pixels have events. Noise that passes a filter has others nearby: it comes in pairs,
which double its variance.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from gpvo.events.clusters import ClusterEvents, StereoCluster

BLOCK = 16
"""Side of the blocks, pixels."""
LEAST = 3.0
"""Mean number of events per block below which nothing can be told."""
REMEMBERED = 5
"""Number of clusters that are counted together where one has too few events."""

Array = NDArray[np.float64]


class Unevenness:
    """Tells how uneven the events of consecutive clusters are, however few they are."""

    def __init__(self) -> None:
        self._latest: deque[list[tuple[Array, float]]] = deque(maxlen=REMEMBERED)

    def clear(self) -> None:
        """Begin again."""
        self._latest.clear()

    def squared_variation(self, cluster: StereoCluster) -> float | None:
        """Return the mean squared coefficient of variation of both cameras' rates, if known.

        Where the cluster has too few events it is that of the latest ones together.
        """
        sides = cluster.left, cluster.right
        self._latest.appendleft([_counted(side) for side in sides])
        totals = [(np.zeros_like(counts), 0.0) for counts, _ in self._latest[0]]
        if not all(len(counts) for counts, _ in totals):  # an image smaller than a block
            return None
        for latest in self._latest:
            totals = [(a + b, m + n) for (a, m), (b, n) in zip(totals, latest, strict=True)]
            if all(counts.mean() >= LEAST for counts, _ in totals):
                return float(np.mean([squared_variation(*total) for total in totals]))
        return None


def squared_variation(counts: Array, chance: float) -> float:
    """Compute the squared coefficient of variation of the rates of blocks with these counts.

    `chance` is the variance of the counts if the rates were equal.
    """
    return float((counts.var() - chance) / counts.mean() ** 2)


def _counted(events: ClusterEvents) -> tuple[Array, float]:
    """Return the numbers of pixels with events in the blocks of a sensor, and chance's variance."""
    counts = block_counts(events.active)
    passed = min(1.0, events.noise_count / max(1, events.event_count)) * counts
    return counts, float((counts * (1 - counts / BLOCK**2) + passed).mean() if len(counts) else 0)


def block_counts(active: NDArray[np.bool_]) -> Array:
    """Return the numbers of pixels (height, width) that are true, block by block."""
    rows, columns = (length // BLOCK for length in active.shape)
    blocks = active[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    return np.asarray(blocks.sum(axis=(1, 3)).ravel(), np.float64)
