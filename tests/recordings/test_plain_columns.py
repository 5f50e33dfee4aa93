"""One pass over columns without faults gives what the checks of single columns give."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.errors import InputError
from gpvo.recordings import Events
from gpvo.recordings.checks import columns
from gpvo.recordings.checks.plain_columns import fill_plain

RESOLUTION = (40, 30)
ORIGIN, LATEST = 1.5e9, 1.5e9 + 1.0


def table(seed: int, count: int) -> list[np.ndarray]:
    """Return columns x, y, t, polarity without faults."""
    rng = np.random.default_rng(seed)
    x, y = (rng.integers(0, size, count).astype(float) for size in RESOLUTION)
    seconds = LATEST + np.sort(rng.integers(0, 50, count)) * 1e-6
    return [x, y, seconds, rng.choice([-1.0, 0.0, 1.0], count)]


def plain(given: list[np.ndarray]) -> Events | None:
    events = Events.empty(len(given[0]))
    return events if fill_plain(events, *given, RESOLUTION, ORIGIN, LATEST) else None


@given(seed=st.integers(0, 99), count=st.integers(1, 60))
@settings(deadline=None, max_examples=50)
def test_columns_without_faults_are_those_of_the_checks(seed: int, count: int) -> None:
    x, y, seconds, polarity = given_columns = table(seed, count)
    events = plain(given_columns)
    columns.check_times(seconds, LATEST, "file")
    for ours, theirs in (
        (events.x, columns.pixels(x, RESOLUTION[0], "x", "file", 0)),
        (events.y, columns.pixels(y, RESOLUTION[1], "y", "file", 0)),
        (events.t, seconds - ORIGIN),
        (events.polarity, columns.polarities(polarity, "file", 0)),
    ):
        np.testing.assert_array_equal(ours, theirs)
        assert ours.dtype == theirs.dtype


FAULTS = [
    *((column, fault) for column in (0, 1) for fault in (-1.0, 0.5, 40.0, 65536.0, 2.0**40)),
    *((column, fault) for column in range(4) for fault in (np.nan, np.inf, -np.inf)),
    (2, LATEST - 1e-6),
    (2, -9e9),
    (2, 9e9),
    *((3, fault) for fault in (0.5, 2.0, -2.0)),
]


@pytest.mark.parametrize(("column", "fault"), FAULTS)
@pytest.mark.parametrize("row", [0, 7, -1])
def test_each_fault_is_left_to_the_checks_which_name_it(
    column: int, fault: float, row: int
) -> None:
    given_columns = table(1, 20)
    given_columns[column][row] = fault
    assert plain(given_columns) is None
    x, y, seconds, polarity = given_columns
    with pytest.raises(InputError):
        columns.check_times(seconds, LATEST, "file")
        columns.pixels(x, RESOLUTION[0], "x", "file", 0)
        columns.pixels(y, RESOLUTION[1], "y", "file", 0)
        columns.polarities(polarity, "file", 0)


def test_no_rows_and_numbers_of_other_machines_are_left_to_the_checks() -> None:
    assert plain([column[:0] for column in table(1, 3)]) is None
    assert plain([column.astype(">f8") for column in table(1, 3)]) is None
