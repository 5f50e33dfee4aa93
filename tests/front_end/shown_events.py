"""Events at any places of the rectified image: each has a raw pixel of its own."""

from __future__ import annotations

import numpy as np

from gpvo.events import ClusterEvents
from gpvo.recordings import Events


def shown(points: np.ndarray, t: np.ndarray, shape: tuple[int, int]) -> ClusterEvents:
    """Make a cluster's events at rectified points (N, 2), times (N,), image (height, width)."""
    count = len(points)
    x, y = np.arange(count, dtype=np.uint16), np.zeros(count, np.uint16)
    events = Events(x, y, t, np.ones(count, bool))
    return ClusterEvents((events,), points[None].astype(np.float32), shape[::-1])


def of_surface(surface: np.ndarray) -> ClusterEvents:
    """Make a cluster's events from the latest time of each pixel (height, width), -inf if none."""
    y, x = np.nonzero(np.isfinite(surface))
    order = np.argsort(surface[y, x], kind="stable")
    x, y = x[order].astype(np.uint16), y[order].astype(np.uint16)
    height, width = surface.shape
    table = np.dstack(np.meshgrid(np.arange(width), np.arange(height))).astype(np.float32)
    events = Events(x, y, surface[y, x], np.ones(len(x), bool))
    return ClusterEvents((events,), table, (width, height))
