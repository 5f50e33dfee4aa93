"""Events that are unpacked many chunks at once equal those of h5py's columns, faults as well."""

from __future__ import annotations

from io import BytesIO

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.recordings import Events, libdeflate
from gpvo.recordings.checks.plain_columns import fill_plain
from gpvo.recordings.files.mvsec_chunks import EventChunks

RESOLUTION, ORIGIN, LATEST = (40, 30), 99.7, 100.0
GZIP = {"compression": "gzip", "shuffle": True}

needs_libdeflate = pytest.mark.skipif(
    not libdeflate.IS_THERE, reason="libdeflate's functions are hidden on this system"
)


def plain_rows(count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    x, y = rng.integers(0, [[RESOLUTION[0]], [RESOLUTION[1]]], (2, count))
    t = LATEST + np.cumsum(rng.integers(0, 3, count)) * 1e-6
    return np.column_stack([x, y, t, rng.choice([-1.0, 0.0, 1.0], count)])


def table(rows: np.ndarray, size: int, **how: object) -> h5py.Dataset:
    file = h5py.File(BytesIO(), "w")
    return file.create_dataset("events", data=rows, chunks=(size, 1), **how)


def filled(dataset: h5py.Dataset, first: int, stop: int) -> tuple[Events, float | None]:
    events, chunks = Events.empty(stop - first), EventChunks.of(dataset)
    assert chunks is not None
    return events, chunks.fill(events, first, RESOLUTION, ORIGIN, LATEST)


FAULTS = st.sampled_from(
    [None, (0, -1.0), (0, 40.0), (1, 30.0), (1, 2.5), (2, 99.0), (2, np.nan), (3, 2.0), (3, np.nan)]
)


@needs_libdeflate
@settings(deadline=None, max_examples=80)
@given(
    count=st.integers(1, 60),
    size=st.integers(1, 20),
    shuffle=st.booleans(),
    ends=st.tuples(st.integers(0, 4), st.integers(1, 60)),
    fault=FAULTS,
    place=st.integers(0, 59),
)
def test_events_equal_those_of_plain_columns(
    count: int,
    size: int,
    shuffle: bool,
    ends: tuple[int, int],
    fault: tuple[int, float] | None,
    place: int,
) -> None:
    size = min(size, count)
    first = min(ends[0] * size, (count - 1) // size * size)
    stop = min(count, first + ends[1])
    rows = plain_rows(count)
    if fault is not None:
        rows[place % count, fault[0]] = fault[1]
    events, last = filled(table(rows, size, compression="gzip", shuffle=shuffle), first, stop)
    given, others = np.ascontiguousarray(rows[first:stop].T), Events.empty(stop - first)
    plain = fill_plain(others, *given, RESOLUTION, ORIGIN, LATEST)
    assert last == (given[2, -1] if plain else None)
    for column in ("x", "y", "t", "polarity") if plain else ():
        np.testing.assert_array_equal(getattr(events, column), getattr(others, column))


@needs_libdeflate
def test_more_rows_than_are_converted_at_once() -> None:
    rows = plain_rows(5000)
    events, last = filled(table(rows, 3000, **GZIP), 0, 5000)
    assert last == rows[-1, 2]
    np.testing.assert_array_equal(events.x, rows[:, 0])
    np.testing.assert_array_equal(events.t, rows[:, 2] - ORIGIN)


@needs_libdeflate
def test_what_is_damaged_or_begins_amid_a_chunk_is_left_to_others() -> None:
    rows = plain_rows(20)
    dataset = table(rows, 10, **GZIP)
    assert filled(dataset, 0, 20)[1] == rows[-1, 2]
    assert filled(dataset, 3, 20)[1] is None
    for damage, left_out in ((b"no zlib", 0), (bytes(1 << 20), 0), (rows[10:, 1].tobytes(), 1)):
        dataset.id.write_direct_chunk((10, 1), damage, filter_mask=left_out)
        assert filled(dataset, 0, 20)[1] is None


def test_other_packings_are_left_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = plain_rows(20)
    assert EventChunks.of(table(rows, 10)) is None
    assert EventChunks.of(table(rows, 10, compression="lzf")) is None
    assert EventChunks.of(table(rows, 10, compression="gzip", fletcher32=True)) is None
    assert EventChunks.of(table(rows.astype(">f8"), 10, **GZIP)) is None
    file = h5py.File(BytesIO(), "w")
    for chunks in (None, (10, 4)):
        packing = GZIP if chunks else {}
        other = file.create_dataset(f"{chunks}", data=rows, chunks=chunks, **packing)
        assert EventChunks.of(other) is None
    monkeypatch.setattr(libdeflate, "IS_THERE", False)
    assert EventChunks.of(table(rows, 10, **GZIP)) is None
