"""Columns unpacked by libdeflate equal those of h5py, which reads all other packings."""

from __future__ import annotations

from io import BytesIO

import h5py
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.recordings.gzip_chunks import GzipChunks


def unpacked_rows(
    dataset: h5py.Dataset, first: int, stop: int, column: int | None = None
) -> np.ndarray | None:
    chunks = GzipChunks.of(dataset, column)
    return None if chunks is None else chunks.rows(first, stop)


def dataset(data: np.ndarray, **how: object) -> h5py.Dataset:
    file = h5py.File(BytesIO(), "w")
    return file.create_dataset("events", data=data, **how)


@settings(deadline=None, max_examples=60)
@given(
    rows=st.integers(1, 60),
    size=st.integers(1, 20),
    shuffle=st.booleans(),
    kind=st.sampled_from(["<f8", ">f8", "<u2", "u1", "<i8"]),
    ends=st.tuples(st.integers(0, 60), st.integers(0, 60)),
)
def test_any_rows_of_any_column(
    rows: int, size: int, shuffle: bool, kind: str, ends: tuple[int, int]
) -> None:
    size = min(size, rows)
    first, stop = sorted(min(end, rows) for end in ends)
    data = np.random.default_rng(rows).integers(0, 200, (rows, 3)).astype(kind)
    packing = {"compression": "gzip", "shuffle": shuffle}
    table = dataset(data, chunks=(size, 1), **packing)
    column = dataset(data[:, 1], chunks=(size,), **packing)
    for ours in (unpacked_rows(table, first, stop, 1), unpacked_rows(column, first, stop)):
        assert (ours is None) == (stop - first < size)
        if ours is not None:
            np.testing.assert_array_equal(ours, data[first:stop, 1])
            assert ours.dtype == data.dtype


def test_other_packings_are_left_to_h5py() -> None:
    data = np.arange(60.0).reshape(20, 3)
    for how in (
        {},
        {"chunks": (10, 1)},
        {"chunks": (10, 3), "compression": "gzip"},
        {"chunks": (10, 1), "compression": "lzf"},
        {"chunks": (10, 1), "compression": "gzip", "fletcher32": True},
    ):
        assert unpacked_rows(dataset(data, **how), 0, 20, 1) is None


def test_what_is_damaged_or_never_written_is_left_to_h5py() -> None:
    data = np.arange(60.0).reshape(20, 3)
    table = dataset(data, chunks=(10, 1), compression="gzip")
    assert unpacked_rows(table, 0, 20, 1) is not None
    table.id.write_direct_chunk((10, 1), b"no zlib")
    assert unpacked_rows(table, 0, 20, 1) is None
    table.id.write_direct_chunk((10, 1), bytes(1 << 20))
    assert unpacked_rows(table, 0, 20, 1) is None
    table.id.write_direct_chunk((10, 1), data[10:, 1].tobytes(), filter_mask=1)
    assert unpacked_rows(table, 0, 20, 1) is None
    np.testing.assert_array_equal(table[:, 1], data[:, 1])
    file = h5py.File(BytesIO(), "w")
    empty = file.create_dataset("e", (20,), "f8", chunks=(10,), compression="gzip")
    assert unpacked_rows(empty, 0, 20) is None
