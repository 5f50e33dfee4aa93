"""Event images for people: blue where pixels became brighter, red where darker, on white."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.events import ClusterEvents

Image = NDArray[np.uint8]

WHITE, ON, OFF = (255, 255, 255), (86, 146, 204), (222, 128, 104)
"""Colours RGB of pixels without events, that became brighter, and darker."""


def event_image(cluster: ClusterEvents) -> Image:
    """Draw the latest event of each rectified pixel, (height, width, 3) RGB."""
    width, height = cluster.resolution
    image = np.full((height, width, 3), WHITE, np.uint8)
    events = cluster.events
    points = cluster.table[events.y, events.x]
    with np.errstate(invalid="ignore"):
        inside = ((points > -0.5) & (points < np.array([width, height]) - 0.5)).all(axis=1)
    columns, rows = np.rint(points[inside]).astype(np.int64).T
    colours = np.where(events.polarity[inside, None], *np.array([ON, OFF], np.uint8))
    image[rows, columns] = colours
    return image
