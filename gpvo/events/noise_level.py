"""Tell the noise of a camera at rest from the few events that a faulty one still sends.

Noise comes from all of the sensor, contours from some of it. With n events in each of many blocks
of pixels, (var n - mean n) / (mean n)^2 is the squared coefficient of variation of their rates:
about 0 for noise, 0.3 and more for the contours of a scene, whatever share of their events is left.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from gpvo.events.clusters import ClusterEvents, StereoCluster

BLOCK = 16
"""Side of the blocks, pixels."""
UNIFORM = 0.2
"""Squared coefficient of variation up to which what is left of many events is noise alone."""
EVEN = 0.13
"""The same as long as nothing is known to compare with: contours among much noise have 0.16."""
LEAST = 3.0
"""Mean number of events per block below which nothing can be told."""
REMEMBERED = 5
"""Number of clusters that are judged together where one has too few events."""


class NoiseLevel:
    """Judges consecutive clusters that hold almost no events, or the first ones of a stream."""

    def __init__(self) -> None:
        self._counts: deque[list[NDArray[np.float64]]] = deque(maxlen=REMEMBERED)

    def clear(self) -> None:
        """Begin again."""
        self._counts.clear()

    def is_noise(self, cluster: StereoCluster) -> bool:
        """Return whether both cameras send noise, as cameras at rest do, and nothing else."""
        variation = self._variation(cluster)
        return variation is not None and variation < UNIFORM

    def may_be_noise(self, cluster: StereoCluster) -> bool | None:
        """Return whether a stream begins with noise of both cameras; None if it has few events."""
        variation = self._variation(cluster)
        return None if variation is None else variation < EVEN

    def _variation(self, cluster: StereoCluster) -> float | None:
        """Return the mean squared coefficient of variation of both cameras' rates, if known."""
        self._counts.appendleft([block_counts(side) for side in (cluster.left, cluster.right)])
        totals = [np.zeros_like(count) for count in self._counts[0]]
        if not all(map(len, totals)):  # an image smaller than a block
            return None
        for latest in self._counts:
            for total, count in zip(totals, latest, strict=True):
                total += count
            if all(total.mean() >= LEAST for total in totals):
                return float(np.mean([squared_variation(total) for total in totals]))
        return None


def squared_variation(counts: NDArray[np.float64]) -> float:
    """Compute the squared coefficient of variation of the rates of blocks with these counts."""
    mean = counts.mean()
    return float((counts.var() - mean) / mean**2)


def block_counts(events: ClusterEvents) -> NDArray[np.float64]:
    """Return the numbers of pixels with events, block by block of the sensor."""
    height, width = events.active.shape
    rows, columns = height // BLOCK, width // BLOCK
    blocks = events.active[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    return np.asarray(blocks.sum(axis=(1, 3)).ravel(), np.float64)
