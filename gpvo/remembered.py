"""Which of all landmarks that were lost are remembered, by tracker and estimator alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]


def remembered(landmark: Index, size: int) -> Index:
    """Return the indices of the lost landmarks (N,) that are kept, `size` at most.

    The one that was lost first comes first. Two thirds of those kept are the latest, which come
    back soonest if the motion turns. The others are spread over all that was lost before, so that
    a place is known again however long ago it was seen: of these stay the landmarks whose
    identities are multiples of the least power of two that leaves few enough. Tracker and
    estimator lose not quite the same ones, and yet keep the same.
    """
    others = size // 3
    first = max(len(landmark) - (size - others), 0)
    before, step = np.arange(first), 1
    while len(before) > others:
        step *= 2
        before = before[(landmark[before] % step == 0) & (landmark[before] > 0)]
    return np.concatenate([before, np.arange(first, len(landmark))])
