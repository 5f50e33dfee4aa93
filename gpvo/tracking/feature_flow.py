"""Image motion everywhere, from the motion of the features around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.tracking.event_sums import CELL, Flow

Array = NDArray[np.float64]

PULL = 0.05
"""Weight of the median motion, where a feature at the centre of a cell has the weight 1."""


def flow_between(
    earlier: Array, later: Array, dt: float, shape: tuple[int, int], reach: float
) -> Flow:
    """Estimate the image motion of all cells from features that moved within dt seconds.

    `earlier` and `later` are the pixels (N, 2) of the same features, and `shape` is (height, width)
    of the image. The motion is the mean of the features' motions, weighted by a Gaussian of the
    distance with the standard deviation `reach` pixels. Far from all features it is their median
    motion.
    """
    height, width = shape
    motion = (later - earlier) / dt
    columns, rows = (CELL * (np.arange(-(-side // CELL)) + 0.5) - 0.5 for side in (width, height))
    across = np.exp(-(((columns[:, None] - later[:, 0]) / reach) ** 2) / 2)
    down = np.exp(-(((rows[:, None] - later[:, 1]) / reach) ** 2) / 2)
    total = np.stack([(down * part) @ across.T for part in motion.T], axis=-1)
    mean = (total + PULL * np.median(motion, axis=0)) / (down @ across.T + PULL)[..., None]
    return np.asarray(mean, np.float32)


def direction(flow: Flow) -> Array:
    """Return the shares (2,) of most cells' motion along u and v; both are whole if none moves."""
    u, v = np.median(np.abs(flow), axis=(0, 1))
    speed = np.hypot(u, v)
    return np.array([u, v], float) / speed if speed > 0 else np.ones(2)


def median_length(ways: Flow) -> float:
    """Return the median length of what is known of all cells (rows, columns, 2)."""
    return float(np.median(np.linalg.norm(ways, axis=2)))
