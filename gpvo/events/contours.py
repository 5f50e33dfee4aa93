"""Thickness of the contours that events have painted, which ends an adaptive cluster.

A contour that has moved by N pixels leaves a band N pixels wide. A band of width w and length l has
the area w l and the perimeter 2 l. Therefore w = 2 area / perimeter, independent of speed, texture
and number of pixels.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK = 2
"""Side of the painted squares, pixels; it closes the gaps of a pixel that faint contours leave."""


def events_until_thick(
    x: NDArray[np.uint16], y: NDArray[np.uint16], resolution: tuple[int, int], thickness: float
) -> int:
    """Count the events that paint bands of a given thickness.

    Parameters
    ----------
    x, y
        (N,) columns and rows of the events, in order of time.
    resolution
        Width and height of the sensor, pixels.
    thickness
        Twice the area over the perimeter of all blocks that had an event, pixels.

    Returns
    -------
    int
        Number of events, counted from the first; N + 1 if the bands stay thinner.
    """
    width, height = (side // BLOCK + 3 for side in resolution)
    painted = np.zeros((height, width), np.bool_)
    return int(_blocks_until_thick(x, y, painted, thickness / BLOCK))


@njit(cache=True)
def _blocks_until_thick(
    x: NDArray[np.uint16], y: NDArray[np.uint16], painted: NDArray[np.bool_], thickness: float
) -> int:
    area = perimeter = 0
    for i in range(len(x)):
        row, column = int(y[i]) // BLOCK + 1, int(x[i]) // BLOCK + 1  # a border of one block
        if painted[row, column]:
            continue
        painted[row, column] = True
        neighbours = int(painted[row - 1, column]) + int(painted[row + 1, column])
        neighbours += int(painted[row, column - 1]) + int(painted[row, column + 1])
        area, perimeter = area + 1, perimeter + 4 - 2 * neighbours
        if 2 * area >= thickness * perimeter:
            return i + 1
    return len(x) + 1
