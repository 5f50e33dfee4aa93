"""Stretches of time with few measurements or none, to shade in the figures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.trajectory import Trajectory

BIN = 0.1
"""Width of the bins in which states are counted, seconds."""

FEW = 0.25
"""Fraction of the median number of states, below which a bin has few states."""

LONGEST_GAP = 0.2
"""Longest gap with measurements, seconds, at most two clusters; in longer ones there are none."""


@dataclass(frozen=True)
class ShadedStretch:
    """Stretch of time to shade, in absolute nanoseconds."""

    start_ns: int
    stop_ns: int
    label: str
    colour: str = "#999999"


def weak_stretches(trajectory: Trajectory) -> list[ShadedStretch]:
    """Find where a trajectory has few states, grey, and where it has none, pink, as in the paper.

    States are at the times of measurements. With states at key times only gaps can be found.
    """
    few = [_stretch(trajectory, *ends, "few measurements") for ends in _thin(trajectory.t)]
    none = [
        _stretch(trajectory, *ends, "motion prior alone", "#cc79a7") for ends in _gaps(trajectory.t)
    ]
    return few + none


def shaded_stretches(
    trajectory: Trajectory, spans: Iterable[tuple[float, float]], label: str
) -> list[ShadedStretch]:
    """Return the stretches between given times, seconds."""
    return [_stretch(trajectory, *span, label, "#cc79a7") for span in spans]


def _stretch(
    trajectory: Trajectory, start: float, stop: float, label: str, colour: str = "#999999"
) -> ShadedStretch:
    start_ns, stop_ns = trajectory.stamps_ns(np.array([start, stop]))
    return ShadedStretch(int(start_ns), int(stop_ns), label, colour)


def _thin(t: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Return the start and stop of runs of bins with few states."""
    edges = np.arange(t[0], t[-1], BIN)
    if len(edges) < 2:
        return []
    counts, _ = np.histogram(t, edges)
    few = (counts > 0) & (counts < FEW * np.median(counts))
    thin = np.concatenate([[False], few, [False]])
    starts, stops = np.flatnonzero(np.diff(thin.astype(int))).reshape(-1, 2).T
    return list(zip(edges[starts], edges[stops], strict=True))


def _gaps(t: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Return the start and stop of long gaps between states."""
    first = np.flatnonzero(np.diff(t) > LONGEST_GAP)
    return list(zip(t[first], t[first + 1], strict=True))
