"""How thick the contours are that events have painted: what an adaptive cluster ends by.

A contour that has moved by N pixels leaves a band N pixels wide. A band of width w and length l has
the area w l and the perimeter 2 l, so that twice the area over the perimeter tells w, whatever the
speed, the texture and the number of pixels.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK = 2
"""Side of the squares that are painted, pixels: faint contours leave gaps of a pixel."""


def events_until_thick(
    x: NDArray[np.uint16], y: NDArray[np.uint16], resolution: tuple[int, int], thickness: float
) -> int:
    """Number of events, the first of (N,) at columns x and rows y, that paint bands so wide.

    Parameters
    ----------
    resolution
        Width and height of the sensor, pixels.
    thickness
        Twice the area over the perimeter of all blocks that had an event, pixels.

    Returns
    -------
    int
        N + 1 if the bands stay thinner.
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
