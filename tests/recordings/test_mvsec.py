"""MVSEC's HDF5 gives the events that were written, however they are cut into batches."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_files import camchain, event_rows, write_mvsec

from gpvo.errors import InputError
from gpvo.recordings import Events, Recording, event_batches, open_recording
from gpvo.recordings.event_batches import stereo_batches
from gpvo.recordings.files import mvsec_table
from gpvo.recordings.files.mvsec import MvsecRecording

COLUMNS = ("x", "y", "t", "polarity")


def read_all(
    recording: Recording, start: float = 0.0, stop: float = np.inf
) -> tuple[Events, Events]:
    batches = list(recording.event_batches(start, stop))
    left = Events.concatenate([batch.left for batch in batches])
    return left, Events.concatenate([batch.right for batch in batches])


def expected(rows: np.ndarray, origin: float) -> Events:
    x, y = rows[:, :2].T.astype(np.uint16)
    return Events(x, y, rows[:, 2] - origin, rows[:, 3] > 0)


def assert_same(events: Events, others: Events) -> None:
    for column in COLUMNS:
        ours, theirs = getattr(events, column), getattr(others, column)
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)


@pytest.fixture(scope="module")
def rows() -> tuple[np.ndarray, np.ndarray]:
    left, right = event_rows(700, 3), event_rows(500, 4, start=1.5e9 + 0.1)
    left[200:230, 2] = left[200, 2]
    return left, right


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, rows: tuple) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("mvsec")
    (folder / "camchain.yaml").write_text(yaml.safe_dump(camchain()))
    return write_mvsec(folder / "data.hdf5", *rows), folder / "camchain.yaml"


@settings(deadline=None, max_examples=20)
@given(
    length=st.floats(0.003, 2.0),
    start=st.floats(-0.2, 0.7),
    stop=st.one_of(st.just(np.inf), st.floats(-0.1, 0.8)),
    block=st.integers(1, 900),
    most=st.integers(1, 300),
)
def test_batches_hold_every_event_once(
    files: tuple, rows: tuple, length: float, start: float, stop: float, block: int, most: int
) -> None:
    recording = MvsecRecording(*files, batch_length=length)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mvsec_table, "BLOCK_ROWS", block)
        patch.setattr(mvsec_table, "CACHED_ROWS", most)
        patch.setattr(event_batches, "MOST", most)
        batches = list(recording.event_batches(start, stop))
    for side, table in zip(("left", "right"), rows, strict=True):
        parts = [getattr(batch, side) for batch in batches]
        whole = expected(table, rows[0][0, 2]).between(start, stop)
        assert_same(Events.concatenate(parts), whole)
        for batch, part in zip(batches, parts, strict=True):
            assert_same(part, whole.between(batch.start, batch.stop))


@settings(deadline=None, max_examples=20)
@given(length=st.floats(0.003, 2.0), start=st.floats(0.0, 0.4), stop=st.floats(0.41, 2.0))
def test_batches_cover_the_interval(files: tuple, length: float, start: float, stop: float) -> None:
    recording = MvsecRecording(*files, batch_length=length)
    batches = list(recording.event_batches(start, stop))
    assert batches[0].start == start
    assert batches[-1].stop == min(stop, np.nextafter(recording.duration, np.inf))
    assert all(a.stop == b.start for a, b in pairwise(batches))
    assert all(0.0 < batch.stop - batch.start <= length * (1 + 1e-9) + 1e-15 for batch in batches)


def test_times_start_at_the_first_event_of_either_camera(tmp_path: Path, calibration: Path) -> None:
    left, right = event_rows(50, 5, start=1.5e9 + 0.2), event_rows(50, 6)
    recording = open_recording(write_mvsec(tmp_path / "a.hdf5", left, right), calibration)
    assert recording.start_ns == round(right[0, 2] * 1e9)
    assert recording.duration == max(left[-1, 2], right[-1, 2]) - right[0, 2]
    ours_left, ours_right = read_all(recording)
    assert_same(ours_left, expected(left, right[0, 2]))
    assert_same(ours_right, expected(right, right[0, 2]))
    stamps = [recording.stamp_ns(t) for t in ours_left.t]
    np.testing.assert_allclose(stamps, left[:, 2] * 1e9, rtol=0, atol=1000)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("row", "shift", "problem"),
    [
        (0, -100.0, "row 0: .*the row below, .* damaged; leave"),
        (-1, 100.0, "row 99: .*the row above, "),
    ],
)
def test_ends_that_are_far_from_all_others_are_refused(
    tmp_path: Path, calibration: Path, side: int, row: int, shift: float, problem: str
) -> None:
    tables = event_rows(100, 5), event_rows(100, 6)
    tables[side][row, 2] += shift
    path = write_mvsec(tmp_path / "a.hdf5", *tables)
    with pytest.raises(InputError, match=f"{('left', 'right')[side]}/events {problem}"):
        open_recording(path, calibration)


@pytest.mark.parametrize("length", [0.1, 70.0])
def test_hours_without_events_are_one_batch(length: float) -> None:
    """Regular batches continue after them, and silence at the end is one batch, too."""
    t = np.array([0.05, 0.17, 50_000.02, 50_000.31])
    events = Events(*np.zeros((2, 4), np.uint16), t, np.ones(4, bool))
    blocks = [events[:3], events[3:]]
    batches = list(stereo_batches(iter(blocks), iter([events[:2]]), 0.0, 90_000.0, length))
    assert len(batches) < 12
    assert all(a.stop == b.start for a, b in pairwise(batches)) and batches[-1].stop == 90_000.0
    assert sum(len(batch.left) for batch in batches) == 4
    assert sum(len(batch.right) for batch in batches) == 2
    for batch in batches:
        assert batch.stop - batch.start < 1.001 * length or len(batch.left) == len(batch.right) == 0


def test_batches_without_events_are_yielded(tmp_path: Path, calibration: Path) -> None:
    rows = np.concatenate([event_rows(20, 7, seconds=0.05), event_rows(20, 8, 1.5e9 + 1.0, 0.05)])
    recording = open_recording(write_mvsec(tmp_path / "gap.hdf5", rows, rows), calibration)
    counts = [len(batch.left) for batch in recording.event_batches()]
    assert counts[0] == 20
    assert sum(counts[1:9]) == 0 and len(counts[1:9]) == 8
    assert sum(counts) == 40


@pytest.mark.parametrize(
    "options",
    [{}, {"compression": "gzip", "chunks": (7, 1)}, {"compression": "lzf", "chunks": (64, 4)}],
)
def test_storage_and_zero_one_polarity(tmp_path: Path, calibration: Path, options: dict) -> None:
    rows = event_rows(300, 9)
    zero_one = rows.copy()
    zero_one[:, 3] = rows[:, 3] > 0
    path = write_mvsec(tmp_path / "a.hdf5", zero_one.astype(">f8"), rows, **options)
    left, right = read_all(open_recording(str(path), str(calibration)))
    assert_same(left, right)
    assert_same(left, expected(rows, rows[0, 2]))


def test_only_blocks_of_the_interval_are_read(
    files: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mvsec_table, "BLOCK_ROWS", 10)
    read = mvsec_table.Column.rows
    rows_read = []

    def counted(column, first_row, stop_row):  # type: ignore[no-untyped-def]
        rows_read.append(stop_row - first_row)
        return read(column, first_row, stop_row)

    monkeypatch.setattr(mvsec_table.Column, "rows", counted)
    recording = MvsecRecording(*files, batch_length=0.01)
    rows_read.clear()
    next(recording.event_batches(0.3))
    assert max(rows_read) == 10
    assert sum(rows_read) < 500


def test_folder_with_one_recording(tmp_path: Path, files: tuple, rows: tuple) -> None:
    folder = tmp_path / "indoor_flying1"
    folder.mkdir()
    for name in ("a_data.hdf5", "a_gt.hdf5"):
        (folder / name).write_bytes(files[0].read_bytes())
    (folder / "camchain.yaml").write_bytes(files[1].read_bytes())
    left, _ = read_all(open_recording(folder))
    assert_same(left, expected(rows[0], rows[0][0, 2]))
    (folder / "b_data.hdf5").write_bytes(files[0].read_bytes())
    with pytest.raises(InputError, match=r"name one: .*a_data\.hdf5 .*b_data\.hdf5"):
        open_recording(folder)


def test_semi_synthetic_slice_of_indoor_flying(shared: Path) -> None:
    recording = open_recording(
        shared / "real/mvsec_indoor_flying1_slice/semi_synthetic_data.hdf5",
        shared / "recordings/camchain-imucam-indoor_flying.yaml",
    )
    left, right = read_all(recording)
    assert (len(left), len(right)) == (37187, 34601)
    assert recording.duration == pytest.approx(0.224, abs=1e-3)
    assert [len(part) for part in read_all(recording, 0.1, 0.12)] == [
        len(left.between(0.1, 0.12)),
        len(right.between(0.1, 0.12)),
    ]
