"""Buckets keep the best points of each cell, and at most the given number."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.tracking.viso2.bucketing import best_per_cell


@given(st.integers(0, 2**32), st.integers(0, 60), st.integers(0, 20), st.integers(1, 4))
@settings(deadline=None, max_examples=60)
def test_the_best_of_each_cell_stay(seed: int, number: int, taken_number: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points, taken = (rng.integers(0, 90, (n, 2)) for n in (number, taken_number))
    length, strength = rng.integers(0, 3, number), rng.integers(0, 3, number)
    kept = best_per_cell(points, (length, strength), taken, 30, count)

    free = dict.fromkeys(np.ndindex(3, 3), count)
    for u, v in taken // 30:
        free[u, v] -= 1
    expected = np.zeros(number, bool)
    for i in sorted(range(number), key=lambda i: (-length[i], -strength[i], i)):
        cell = tuple((points[i] // 30).tolist())
        expected[i] = free[cell] > 0
        free[cell] -= 1
    np.testing.assert_array_equal(kept, expected)
