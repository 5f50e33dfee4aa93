"""Event images for people: blue where pixels became brighter, red where darker, on white."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.events import ClusterEvents

Image = NDArray[np.uint8]

COLOURS = np.array([(255, 255, 255), (86, 146, 204), (222, 128, 104)], np.uint8)
"""RGB of pixels without events, that became brighter, and darker."""


def event_image(cluster: ClusterEvents) -> Image:
    """Draw the latest event of each rectified pixel, (height, width, 3) RGB."""
    return np.asarray(COLOURS[event_signs(cluster)])


def event_signs(cluster: ClusterEvents) -> Image:
    """Number the colour of each rectified pixel, (height, width)."""
    (width, height), events = cluster.resolution, cluster.events
    u, v = np.rint(cluster.table[events.y, events.x]).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)  # not a number is outside
    signs = np.zeros((height, width), np.uint8)
    pixels = v[inside].astype(np.int64) * width + u[inside].astype(np.int64)
    signs.reshape(-1)[pixels] = np.where(events.polarity[inside], 1, 2)
    return signs
