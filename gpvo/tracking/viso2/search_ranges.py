"""Ranges in which the steps of a quad search: the whole range, or near sparse matches.

The two stages of LIBVISO2: displacements of a first, sparse set of matches bound the search of all.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gpvo.config import Viso2Config

STEPS = 4
"""Number of steps: current left to current right, previous right, previous left, and back."""
STEREO_STEPS = [0, 2]


@dataclass(frozen=True, eq=False)
class SearchRanges:
    """Allowed displacements of the steps of a quad, by the cell in which it starts.

    Attributes
    ----------
    windows
        (rows, columns, STEPS, 4) lowest and highest displacement along u, then along v, pixels.
    cell
        Side of a cell, pixels.
    """

    windows: NDArray[np.float64]
    cell: int

    def at(self, points: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return the windows (STEPS, N, 4) of quads that start at points (N, 2) of current left."""
        row, column = self.cells(points)
        return self.windows[row, column].swapaxes(0, 1)

    def cells(self, points: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the row and column (N,) of the cells in which points (N, 2) lie."""
        last = np.array(self.windows.shape[1::-1]) - 1
        column, row = np.minimum(points // self.cell, last).astype(np.int64).T
        return row, column


def everywhere(shape: tuple[int, ...], frames_between: int, config: Viso2Config) -> SearchRanges:
    """Make equal ranges for all cells of an image of `shape` (height, width)."""
    flow = config.flow_radius * frames_between
    rows = config.row_tolerance
    to_right = [-config.max_disparity, -1, -rows, rows]
    to_left = [1, config.max_disparity, -rows, rows]
    anywhere = [-flow, flow, -flow, flow]
    windows = np.array([to_right, anywhere, to_left, anywhere], np.float64)
    height, width = (-(-length // config.range_cell) for length in shape)
    return SearchRanges(np.broadcast_to(windows, (height, width, STEPS, 4)), config.range_cell)


def near_matches(
    quads: NDArray[np.int32], ranges: SearchRanges, least_width: float
) -> SearchRanges:
    """Narrow ranges to the displacements of the matches in and around each cell.

    Matches are points (4, N, 2) of quads, the first in current left. Narrower ranges are widened to
    `least_width` pixels. The given ranges are kept for rows between left and right, and for cells
    without matches around them.
    """
    cells = ranges.cells(quads[0])
    displacements = (np.roll(quads, -1, axis=0) - quads).swapaxes(0, 1)
    shape = ranges.windows.shape[:2]
    lowest, highest = (np.full((*shape, STEPS, 2), limit) for limit in (np.inf, -np.inf))
    np.minimum.at(lowest, cells, displacements)
    np.maximum.at(highest, cells, displacements)
    lowest, highest = -_highest_around(-lowest), _highest_around(highest)
    unknown = highest < lowest
    widening = np.ceil(np.maximum(least_width - (highest - lowest), 0) / 2)
    lowest[unknown], highest[unknown], widening[unknown] = -np.inf, np.inf, 0
    lowest[:, :, STEREO_STEPS, 1], highest[:, :, STEREO_STEPS, 1] = -np.inf, np.inf
    windows = ranges.windows.copy()
    windows[..., 0::2] = np.maximum(windows[..., 0::2], lowest - widening)
    windows[..., 1::2] = np.minimum(windows[..., 1::2], highest + widening)
    return SearchRanges(windows, ranges.cell)


def _highest_around(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the maximum over the 3 x 3 cells around each of values (rows, columns, STEPS, 2)."""
    rows, columns = values.shape[:2]
    layers = values.reshape(rows, columns, -1)
    around = [
        cv2.dilate(layer, np.ones((3, 3)), borderType=cv2.BORDER_REPLICATE)
        for layer in np.moveaxis(layers, 2, 0)
    ]
    return np.stack(around, axis=-1).reshape(values.shape)
