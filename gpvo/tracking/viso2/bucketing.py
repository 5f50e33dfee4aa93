"""Few features everywhere instead of many in one place: at most so many per cell of the image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def best_per_cell(
    points: NDArray,
    ranking: tuple[NDArray, ...],
    taken: NDArray,
    cell: int,
    count: int,
) -> NDArray[np.bool_]:
    """Which points (N, 2) are among the best of their cell, `cell` pixels wide and high.

    Better is what is larger in the first array (N,) of the ranking, then in the next; the earlier
    point if all are equal. Points `taken` (M, 2) count among the `count` that a cell may have.
    """
    cells = np.concatenate([taken, points]) // cell
    _, number = np.unique(cells, axis=0, return_inverse=True)
    occupied = np.bincount(number[: len(taken)], minlength=len(cells))
    number = number[len(taken) :]
    order = np.lexsort([-values for values in reversed(ranking)] + [number])
    _, first, size = np.unique(number[order], return_index=True, return_counts=True)
    place = np.empty(len(points), np.int64)
    place[order] = np.arange(len(points)) - np.repeat(first, size)
    return place + occupied[number] < count
