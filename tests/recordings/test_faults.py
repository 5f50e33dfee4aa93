"""Every fault of a recording is one InputError of one line that names the file and the field."""

from __future__ import annotations

import bz2
import gzip
import lzma
import os
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from tarfile import TarFile, TarInfo
from types import ModuleType
from zipfile import ZipFile

import h5py
import numpy as np
import pytest
from encoders import START_NS, column_file, event_block
from recording_files import event_rows, write_mvsec

from gpvo.errors import InputError
from gpvo.recordings import Events, Recording, StereoEvents, open_recording
from gpvo.recordings.checks.time_unit import check_time_unit, fitting_unit
from gpvo.recordings.event_batches import stereo_batches

GOOD = event_rows(300, 1)


def fault(path: Path, calibration: Path | None) -> str:
    """Return the message of the error that opening or reading raises."""
    with pytest.raises(InputError) as caught:
        for _batch in open_recording(path, calibration).event_batches():
            pass
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message


def changed(row: int, column: int, value: float) -> np.ndarray:
    rows = GOOD.copy()
    rows[row, column] = value
    return rows


def test_no_recording(tmp_path: Path, calibration: Path) -> None:
    assert "no such file" in fault(tmp_path / "missing.hdf5", calibration)
    assert "not a file" in fault(tmp_path, calibration)
    text = tmp_path / "text.hdf5"
    text.write_text("these are no events")
    assert "davis/left/events" in fault(text, calibration)
    empty = tmp_path / "empty.hdf5"
    empty.write_bytes(b"")
    assert "not a recording" in fault(empty, calibration)


@pytest.mark.parametrize("kind", ["zip", "gzip", "bzip2", "xz", "tar"])
def test_packed_recordings(tmp_path: Path, calibration: Path, kind: str) -> None:
    """What an archive holds is not read, also where it is text that is not compressed."""
    lines = "".join(f"{t / 1e6:.6f} 1 2 0\n" for t in range(5000)).encode()
    packers: dict[str, ModuleType] = {"gzip": gzip, "bzip2": bz2, "xz": lzma}
    for side in ("left", "right"):
        path = tmp_path / f"{side}.txt"
        if kind in packers:
            path.write_bytes(packers[kind].compress(lines))
        elif kind == "zip":
            with ZipFile(path, "w") as packed:
                packed.writestr("events.txt", lines)
        else:
            with TarFile(path, "w") as packed_files:
                entry = TarInfo("events.txt")
                entry.size = len(lines)
                packed_files.addfile(entry, BytesIO(lines))
    assert f"is packed by {kind}; unpack it first" in fault(tmp_path / "left.txt", calibration)


def test_a_pipe(tmp_path: Path, calibration: Path) -> None:
    """It would wait for ever for what is written to it."""
    os.mkfifo(tmp_path / "left.raw")
    assert "is a pipe or a device" in fault(tmp_path / "left.raw", calibration)


def test_hdf5_without_cameras(tmp_path: Path, calibration: Path) -> None:
    path = tmp_path / "other.hdf5"
    with h5py.File(path, "w") as file:
        file["images"] = np.zeros(3)
    assert "davis/left/events" in fault(path, calibration)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("table", "problem"),
    [
        (None, "is missing"),
        (GOOD[:0], "holds no events"),
        (GOOD[:, :3], "N x 4 float64"),
        (GOOD[:, 2], "N x 4 float64"),
        (GOOD.astype(np.float32), "N x 4 float64"),
        (GOOD.astype(np.int64), "N x 4 float64"),
        (h5py.Empty("f8"), "N x 4 float64"),
        (5.0, "N x 4 float64"),
        ("text", "N x 4 float64"),
        (changed(0, 2, np.nan), "row 0: time nan"),
        (changed(299, 2, np.inf), "row 299: time inf"),
        (changed(120, 2, np.nan), "row 120: time nan"),
        (changed(120, 2, 1.5e15), "row 120: time 1500000000000000.0"),
        (changed(120, 0, 64.0), "row 120: x = 64.0 is not a whole number from 0 to 63"),
        (changed(121, 0, -1.0), "row 121: x = -1.0"),
        (changed(121, 0, 0.5), "row 121: x = 0.5"),
        (changed(122, 1, 48.0), "row 122: y = 48.0 is not a whole number from 0 to 47"),
        (changed(122, 1, np.nan), "row 122: y = nan"),
        (changed(122, 1, 65536.0), "row 122: y = 65536.0"),
        (changed(123, 3, 2.0), "row 123: polarity 2.0"),
        (changed(123, 3, np.nan), "row 123: polarity nan"),
    ],
)
def test_unusable_events(
    tmp_path: Path, calibration: Path, side: str, table: object, problem: str
) -> None:
    tables = {"left": GOOD, "right": GOOD, side: table}
    message = fault(write_mvsec(tmp_path / "a.hdf5", **tables), calibration)
    assert f"davis/{side}/events" in message
    assert problem in message


@pytest.mark.parametrize("block", [1, 7, 90, 300])
def test_times_that_go_backwards(
    tmp_path: Path, calibration: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpvo.recordings.files.mvsec_table.BLOCK_ROWS", block)
    early = GOOD[89, 2] - 0.011
    message = fault(write_mvsec(tmp_path / "a.hdf5", GOOD, changed(90, 2, early)), calibration)
    assert "davis/right/events row 90:" in message
    assert f"{early:.6f}" in message and f"{GOOD[89, 2]:.6f}" in message


@pytest.mark.parametrize("block", [1, 7, 90, 300])
def test_small_disorder_is_sorted_and_counted(
    tmp_path: Path, calibration: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No more than 10 ms, also across blocks, at the beginning and at the end."""
    monkeypatch.setattr("gpvo.recordings.files.mvsec_table.BLOCK_ROWS", block)
    rng = np.random.default_rng(0)
    order = np.argsort(GOOD[:, 2] + rng.uniform(0, 0.004, len(GOOD)), kind="stable")
    path = write_mvsec(tmp_path / "a.hdf5", GOOD[order], GOOD)
    recording = open_recording(path, calibration)
    batches = list(recording.event_batches())
    left, right = (
        Events.concatenate(getattr(batch, side) for batch in batches) for side in ("left", "right")
    )
    np.testing.assert_array_equal(left.t, right.t)
    np.testing.assert_array_equal(np.sort(left.x), np.sort(right.x))
    (line,) = recording.fault_lines()
    late = int((np.maximum.accumulate(GOOD[order, 2]) > GOOD[order, 2]).sum())
    assert late > 0 and f"davis/left/events: {late} events out of order" in line
    span = 0.4 * recording.duration, 0.6 * recording.duration
    times = np.concatenate([batch.left.t for batch in recording.event_batches(*span)])
    np.testing.assert_array_equal(times, right.between(*span).t)


@pytest.mark.parametrize(
    ("unit", "seconds"), [("milliseconds", 1e-3), ("microseconds", 1e-6), (None, 1.0)]
)
def test_times_in_another_unit_are_refused_with_its_name(unit: str | None, seconds: float) -> None:
    """A hundred thousand events per second, stamped in whole microseconds."""
    t = np.sort(np.random.default_rng(0).integers(0, 50_000, 5000)) * 1e-6 / seconds
    pixels = np.zeros(len(t), np.uint16)
    events = Events(pixels, pixels, t, pixels > 0)

    class Stream(Recording):
        path, start_ns = Path("stream"), 0

        def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
            return stereo_batches(iter([events]), iter([events]), 0.0, t[-1] + 1, t[-1] / 10)

    if unit is None:
        check_time_unit(Stream())
        return
    with pytest.raises(InputError, match=f"are the times {unit}\\? they must be seconds"):
        check_time_unit(Stream())


def test_times_of_which_few_are_left_in_seconds_are_refused() -> None:
    """Microseconds read as seconds: the first minutes hold next to nothing."""
    t = np.arange(0.0, 2000.0, 37.0)
    pixels = np.zeros(len(t), np.uint16)
    events = Events(pixels, pixels, t, pixels > 0)

    class Stream(Recording):
        path, start_ns = Path("stream"), 0

        def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
            return stereo_batches(iter([events]), iter([events]), 0.0, t[-1] + 1, 0.1)

    with pytest.raises(InputError, match=r"are the times microseconds\? they must be seconds"):
        check_time_unit(Stream())


@pytest.mark.parametrize(("unit", "ratio"), [("milliseconds", 1e3), ("microseconds", 1e6)])
def test_stamps_since_1970_name_their_unit(
    tmp_path: Path, calibration: Path, unit: str, ratio: float
) -> None:
    """In MVSEC's table they would be far in the future."""
    rows = GOOD * [1, 1, ratio, 1]
    message = fault(write_mvsec(tmp_path / "a.hdf5", rows, rows), calibration)
    assert (
        f"davis/left/events row 0: time {rows[0, 2]:.17g} seems to be {unit} since 1970" in message
    )
    assert "times must be seconds: convert them" in message


@pytest.mark.parametrize(
    ("kind", "unit", "length_ns"),
    [
        ("float", "milliseconds", 10**6),
        ("float", "microseconds", 10**3),
        ("int", "nanoseconds", 1),
        ("int", "milliseconds", 10**6),
    ],
)
def test_columns_with_stamps_since_1970_name_their_unit(
    tmp_path: Path, calibration: Path, kind: str, unit: str, length_ns: int
) -> None:
    """Floats must be seconds, whole numbers microseconds."""
    block = event_block(20_000, 1)
    t = block.t_ns / length_ns if kind == "float" else block.t_ns // length_ns
    for side in ("left", "right"):
        changes = {"events/t": t, "t_offset": None, "ms_to_idx": None}
        column_file(tmp_path / f"{side}.h5", block, **changes)
    with pytest.raises(InputError, match=f"{unit} since 1970") as caught:
        open_recording(tmp_path, calibration)
    assert f"must be {'seconds' if kind == 'float' else 'microseconds'}" in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path))


def test_whole_nanoseconds_read_as_microseconds_are_named(
    tmp_path: Path, calibration: Path
) -> None:
    block = event_block(20_000, 1)
    changes = {"events/t": block.t_ns - START_NS, "t_offset": None, "ms_to_idx": None}
    for side in ("left", "right"):
        column_file(tmp_path / f"{side}.h5", block, **changes)
    with pytest.raises(InputError, match="are the times nanoseconds\\? they must be microseconds"):
        open_recording(tmp_path, calibration)


def test_few_events_per_second_in_seconds_are_no_other_unit() -> None:
    """A quiet camera, whose stamps have the resolution of microseconds."""
    t = np.sort(np.random.default_rng(0).uniform(0, 30, 3000)).round(6)
    assert fitting_unit(t, 100.0) is None


@pytest.mark.parametrize("block", [1, 7, 90, 300])
def test_last_time_before_others(
    tmp_path: Path, calibration: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No events are lost silently if the stream seems to end early."""
    monkeypatch.setattr("gpvo.recordings.files.mvsec_table.BLOCK_ROWS", block)
    rows = changed(299, 2, GOOD[100, 2])
    message = fault(write_mvsec(tmp_path / "a.hdf5", rows, rows), calibration)
    assert "davis/left/events row 299:" in message
    assert f"{GOOD[100, 2]:.6f}" in message


def test_last_time_before_first(tmp_path: Path, calibration: Path) -> None:
    rows = changed(299, 2, 1.4e9)
    assert "row 299" in fault(write_mvsec(tmp_path / "a.hdf5", rows, GOOD), calibration)


def test_clocks_that_differ(tmp_path: Path, calibration: Path) -> None:
    later = event_rows(300, 1, start=1.5e9 + 16.777)
    message = fault(write_mvsec(tmp_path / "a.hdf5", GOOD, later), calibration)
    assert "no time in common" in message
    microseconds = GOOD * [1, 1, 1e6, 1] - [0, 0, 1.5e15, 0]
    microseconds[-1, 2] = 1e7
    message = fault(write_mvsec(tmp_path / "a.hdf5", GOOD, microseconds), calibration)
    assert "must be seconds" in message


def test_calibration_is_needed(recording_path: Path) -> None:
    assert "--calibration camchain.yaml" in fault(recording_path, None)


@pytest.mark.parametrize("attributes", [{"width": 346, "height": 260}, {"width": "wide"}])
def test_stated_resolution(recording_path: Path, calibration: Path, attributes: dict) -> None:
    with h5py.File(recording_path, "a") as file:
        file["davis/right/events"].attrs.update(attributes)
    assert "davis/right/events" in fault(recording_path, calibration)


def test_stated_resolution_that_agrees(recording_path: Path, calibration: Path) -> None:
    with h5py.File(recording_path, "a") as file:
        file["davis/left/events"].attrs.update({"width": 64, "height": 48})
    batches = open_recording(recording_path, calibration).event_batches()
    assert sum(len(batch.left) for batch in batches) == 900


@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "chunks": (50, 1)}])
def test_truncation_anywhere(tmp_path: Path, calibration: Path, options: dict) -> None:
    whole = write_mvsec(tmp_path / "whole.hdf5", GOOD, GOOD, **options).read_bytes()
    path = tmp_path / "cut.hdf5"
    cuts = np.random.default_rng(0).integers(0, len(whole), 150)
    for size in (*range(12), *cuts, len(whole) - 1):
        path.write_bytes(whole[:size])
        fault(path, calibration)


@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "chunks": (50, 1)}])
def test_zeroed_bytes_never_crash(tmp_path: Path, calibration: Path, options: dict) -> None:
    whole = write_mvsec(tmp_path / "whole.hdf5", GOOD, GOOD, **options).read_bytes()
    path = tmp_path / "damaged.hdf5"
    failures = 0
    for at in np.random.default_rng(1).integers(0, len(whole) - 64, 60):
        path.write_bytes(whole[:at] + bytes(64) + whole[at + 64 :])
        try:
            sum(len(batch.left) for batch in open_recording(path, calibration).event_batches())
        except InputError:
            failures += 1
    assert failures > 0
