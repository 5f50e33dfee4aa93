"""Bucketing of features: a limited number per cell, so that they cover the whole image."""

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
    """Return which points (N, 2) are among the best of their cell, `cell` pixels wide and high.

    The better point has the larger value in the first array (N,) of the ranking, then in the next.
    The earlier point is better if all are equal. A cell may have `count` points, including the
    points `taken` (M, 2).
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
