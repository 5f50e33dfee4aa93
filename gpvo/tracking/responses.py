"""Responses of LIBVISO2's blob and corner filter, both in one pass over an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel

Response = NDArray[np.int16]
Row = NDArray[np.uint8]
Line = NDArray[np.int16]

BLOB_MASK = np.array(
    [
        [-1, -1, -1, -1, -1],
        [-1, 1, 1, 1, -1],
        [-1, 1, 8, 1, -1],
        [-1, 1, 1, 1, -1],
        [-1, -1, -1, -1, -1],
    ]
)
CORNER_MASK = np.outer([1, 1, 0, -1, -1], [1, 1, 0, -1, -1])
LARGEST_BLOB, LARGEST_CORNER = (
    255 * int(mask[mask > 0].sum()) for mask in (BLOB_MASK, CORNER_MASK)
)
"""Largest responses that there can be."""


@kernel
def blob_and_corner(image: NDArray[np.uint8]) -> tuple[Response, Response]:
    """Correlate an 8-bit image (height, width) with both masks; 0 at two pixels of the border.

    The blob mask is 7 at its middle, 2 in a square of 3 x 3 and -1 in one of 5 x 5.
    """
    height, width = image.shape
    blob, corner = np.zeros(image.shape, np.int16), np.zeros(image.shape, np.int16)
    narrow, wide = np.empty(width, np.int16), np.empty(width, np.int16)
    slope = np.empty(width, np.int16)
    for v in range(2, height - 2):
        a, b, c, d, e = image[v - 2], image[v - 1], image[v], image[v + 1], image[v + 2]
        _sum_columns(a, b, c, d, e, narrow, wide, slope)
        _sum_rows(image[v], narrow, wide, slope, blob[v], corner[v])
    return blob, corner


@kernel
def _sum_columns(
    a: Row, b: Row, c: Row, d: Row, e: Row, narrow: Line, wide: Line, slope: Line
) -> None:
    """Sum three and five rows, and take the lower two of five from the upper two."""
    for u in range(len(wide)):
        narrow[u] = np.int16(b[u]) + np.int16(c[u]) + np.int16(d[u])
        wide[u] = narrow[u] + np.int16(a[u]) + np.int16(e[u])
        slope[u] = np.int16(a[u]) + np.int16(b[u]) - np.int16(d[u]) - np.int16(e[u])


@kernel
def _sum_rows(middle: Row, narrow: Line, wide: Line, slope: Line, blob: Line, corner: Line) -> None:
    for u in range(2, len(wide) - 2):
        square = narrow[u - 1] + narrow[u] + narrow[u + 1]
        around = wide[u - 2] + wide[u - 1] + wide[u] + wide[u + 1] + wide[u + 2]
        blob[u] = 7 * np.int16(middle[u]) + 2 * square - around
        corner[u] = slope[u - 2] + slope[u - 1] - slope[u + 1] - slope[u + 2]
