"""Which lost landmarks are remembered."""

from __future__ import annotations

import numpy as np
import pytest

from gpvo.remembered import remembered


@pytest.mark.parametrize("size", [0, 1, 2, 7, 300])
def test_not_more_than_the_size_and_the_latest(size: int) -> None:
    for count in (0, size // 2, size, size + 1, 5 * size + 100):
        kept = remembered(np.arange(count), size)
        assert len(kept) <= size
        assert (np.diff(kept) > 0).all()
        latest = np.arange(count)[count - min(count, size - size // 3) :]
        np.testing.assert_array_equal(kept[len(kept) - len(latest) :], latest)


def test_those_of_long_ago_are_spread_over_all_the_time() -> None:
    """They come one after the other, and what is forgotten once is forgotten."""
    kept = np.empty(0, np.int64)
    for landmark in range(10_000):
        kept = np.append(kept, landmark)
        kept = kept[remembered(kept, 90)]
    assert len(kept) <= 90 and (kept >= 9_940).sum() == 60
    count, _ = np.histogram(kept, bins=np.arange(0, 10_001, 2_000))
    assert (count[:-1] >= 3).all()


def test_two_that_are_asked_at_different_times_remember_the_same() -> None:
    """As the tracker, which does not know of all landmarks, and the estimator."""
    some, kept = np.empty(0, np.int64), np.empty(0, np.int64)
    for landmark in range(0, 6_000, 30):
        new = np.arange(landmark, landmark + 30)
        kept = np.append(kept, new)
        kept = kept[remembered(kept, 200)]
        some = np.append(some, new[new % 3 > 0])
        some = some[remembered(some, 200)]
    assert np.isin(some[some % 3 > 0], kept).mean() > 0.6
