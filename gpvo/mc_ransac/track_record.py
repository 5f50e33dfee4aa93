"""How landmarks were judged before: what moves by itself was an outlier again and again.

A person who walks by has a velocity as the scene has. Where the camera turns round, no constant
velocity explains the scene for some time, or it makes few events, and the largest set of segments
that one velocity explains may be the person's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MOST = 3
"""Judgements that count at most: a landmark may be trusted again after as many."""
REMEMBERED = 2000
"""Number of landmarks that are remembered, those judged last."""


class TrackRecord:
    """Counts of each landmark as an inlier, less those as an outlier."""

    def __init__(self) -> None:
        self._balance: dict[int, int] = {}  # those judged last come last

    def trusted(self, landmark: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which landmarks (N,) were not outliers more often than inliers.

        They are all trusted if those are not most of them: what they were judged by was wrong.
        """
        balance = np.array([self._balance.get(number, 0) for number in landmark.tolist()])
        trusted = balance >= 0
        return trusted if 2 * trusted.sum() > len(trusted) else np.ones_like(trusted)

    def judge(self, landmark: NDArray[np.int64], inliers: NDArray[np.bool_]) -> None:
        """Remember which landmarks (N,) were inliers (N,) of a velocity."""
        for number, inlier in zip(landmark.tolist(), inliers.tolist(), strict=True):
            balance = self._balance.pop(number, 0) + (1 if inlier else -1)
            self._balance[number] = min(max(balance, -MOST), MOST)
        for number in list(self._balance)[: len(self._balance) - REMEMBERED]:
            del self._balance[number]
