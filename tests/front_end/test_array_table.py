"""Tables of arrays are cut and joined column by column."""

from __future__ import annotations

import numpy as np
import pytest

from gpvo.array_table import ArrayTable
from gpvo.mc_ransac import Segments
from gpvo.recordings import Events
from gpvo.recordings.streams import EventBlock
from gpvo.tracking import Measurements, Observations
from gpvo.trajectory import States

N = np.arange(5)
TABLES = [
    Events(N.astype(np.uint16), N.astype(np.uint16), N / 2, N > 2),
    EventBlock(N.astype(np.uint16), N.astype(np.uint16), N, N > 2),
    Observations(N, N, np.ones((5, 2)) * N[:, None], np.zeros((5, 2))),
    Measurements(N, N, N / 2, np.ones((5, 3)) * N[:, None]),
    Segments(np.ones((5, 3)) * N[:, None], np.zeros((5, 3)), N / 2 + 1),
    States(N / 2, np.tile(np.eye(4), (5, 1, 1)), np.zeros((5, 6))),
]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: type(table).__name__)
def test_parts_join_to_the_whole(table: ArrayTable) -> None:
    joined = type(table).concatenate([table[:2], table[np.array([2])], table[N > 2]])
    assert type(joined) is type(table) and len(joined) == len(table) == 5
    for name, column in vars(table).items():
        if column is not None:
            again = getattr(joined, name)
            np.testing.assert_array_equal(again, column)
            assert again.dtype == column.dtype


def test_nothing_joins_to_nothing() -> None:
    assert len(Events.concatenate([])) == len(Measurements.concatenate([])) == 0
