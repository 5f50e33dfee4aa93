"""One file per camera: DSEC, TUM-VIE, VECtor, event_utils, text, AEDAT4; one file: M3ED."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import lz4.frame
import numpy as np
import pytest
import zstandard
from encoders import START_NS, column_file, event_block, shifted, text_file
from reading import assert_recording_holds, assert_same_events, read_stream
from recording_files import HEIGHT, WIDTH

from gpvo.errors import InputError
from gpvo.recordings import open_recording, read_calibration
from gpvo.recordings.files import hdf5_rows
from gpvo.recordings.files.aedat4 import MAGIC, Aedat4, Aedat4Stream
from gpvo.recordings.files.hdf5_columns import DSEC, ColumnStream
from gpvo.recordings.streams import EventBlock, Faults
from gpvo.recordings.writing.aedat4 import HEADER, STREAM, event_packet, io_header

LEFT, RIGHT = event_block(900, 1), event_block(800, 2)

NAMES = {
    "DSEC": "events/{side}/events.h5",
    "DSEC zip": "zurich_events_{side}/events.h5",
    "TUM-VIE": "mocap-desk-events_{side}.h5",
    "VECtor": "desk1.synced.{side}_event.hdf5",
}


def pair_of_files(folder: Path, name: str, **changes: Any) -> list[Path]:
    return [
        column_file(folder / name.format(side=side), block, **changes)
        for side, block in (("left", LEFT), ("right", RIGHT))
    ]


@pytest.mark.parametrize("name", NAMES)
def test_layouts_on_disk(tmp_path: Path, calibration: Path, name: str) -> None:
    folder = tmp_path / "sequence"
    for path in (*pair_of_files(folder, NAMES[name]), folder):
        assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


def test_vector_packing(tmp_path: Path, calibration: Path) -> None:
    """Columns are packed by Zstd without Blosc, and the offset is in an array of one."""
    for path in pair_of_files(tmp_path, NAMES["VECtor"]):
        with h5py.File(path, "a") as file:
            offset, t = file["t_offset"][()], file["events/t"][:]
            del file["t_offset"], file["events/t"]
            file["t_offset"] = np.array([offset])
            file.create_dataset("events/t", data=t, **hdf5plugin.Zstd())
    assert_recording_holds(open_recording(tmp_path, calibration), LEFT, RIGHT)


def test_tum_vie_has_no_offset(tmp_path: Path, calibration: Path) -> None:
    blocks = shifted(LEFT, -START_NS), shifted(RIGHT, -START_NS)
    for side, block in zip(("left", "right"), blocks, strict=True):
        path = tmp_path / NAMES["TUM-VIE"].format(side=side)
        column_file(path, block, t_offset=None, **{"events/t": block.t_ns // 1000}, ms_to_idx=None)
    assert_recording_holds(open_recording(tmp_path, calibration), *blocks)


def test_event_utils(tmp_path: Path, calibration: Path) -> None:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        with h5py.File(tmp_path / f"{side}.h5", "w") as file:
            file["events/xs"], file["events/ys"] = (
                block.x.astype(np.int16),
                block.y.astype(np.int16),
            )
            file["events/ts"], file["events/ps"] = block.t_ns / 1e9, block.polarity
    assert_recording_holds(open_recording(tmp_path, calibration), LEFT, RIGHT)


def test_text(tmp_path: Path, calibration: Path) -> None:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        text_file(tmp_path / side / "events.txt", block)
    expected = shifted(LEFT, -START_NS), shifted(RIGHT, -START_NS)
    for path in (tmp_path, tmp_path / "right/events.txt"):
        assert_recording_holds(open_recording(path, calibration), *expected)


def test_damaged_lines_are_counted(tmp_path: Path, calibration: Path) -> None:
    for side in ("left", "right"):
        text_file(tmp_path / f"{side}.txt", LEFT)
    lines = (tmp_path / "left.txt").read_text().splitlines()
    lines[100], lines[200], lines[300] = "0.1 3", "a b c d", "nan 1 1 0"
    (tmp_path / "left.txt").write_text("# t x y p\n" + "\n".join(lines) + "\n0.6 1")
    recording = open_recording(tmp_path / "left.txt", calibration)
    assert sum(len(batch.left) for batch in recording.event_batches()) == 897
    assert any("4 damaged lines" in line for line in recording.fault_lines())


@pytest.fixture
def m3ed(tmp_path: Path) -> Path:
    path = tmp_path / "car_urban_data.h5"
    lens = {
        "camera_model": "pinhole",
        "distortion_model": "radtan",
        "distortion_coeffs": [-0.05, 0.01, 0.0, 0.0],
        "intrinsics": [42.0, 41.5, 32.3, 24.6],
        "resolution": [WIDTH, HEIGHT],
    }
    T_left_right = np.eye(4)
    T_left_right[0, 3] = 0.12
    with h5py.File(path, "w") as file:
        for side, block, T in (("left", LEFT, np.eye(4)), ("right", RIGHT, T_left_right)):
            group = file.create_group(f"prophesee/{side}")
            t = (block.t_ns - START_NS) // 1000
            group["x"], group["y"], group["t"], group["p"] = block.x, block.y, t, block.polarity
            group["ms_map_idx"] = np.searchsorted(t, 1000 * np.arange(t[-1] // 1000 + 1))
            for name, value in (lens | {"T_to_prophesee_left": T}).items():
                group[f"calib/{name}"] = value
    return path


def test_m3ed_carries_its_calibration(m3ed: Path) -> None:
    recording = open_recording(m3ed)
    assert recording.rig.baseline == pytest.approx(0.12)
    assert read_calibration(m3ed).focal_length == recording.rig.focal_length
    assert_recording_holds(recording, shifted(LEFT, -START_NS), shifted(RIGHT, -START_NS))


def test_worked_example_of_the_index(tmp_path: Path) -> None:
    """The times t and their ms_to_idx are the example in DSEC's documentation."""
    t = np.array([0, 500, 2100, 5000, 5000, 7100, 7200, 7200, 8100, 9000], np.uint32)
    index = np.array([0, 2, 2, 3, 3, 3, 5, 5, 8, 9], np.uint64)
    ones = np.ones(10, np.uint16)
    datasets = {"events/x": ones, "events/y": ones, "events/t": t, "events/p": ones}
    path = column_file(tmp_path / "a.h5", LEFT, **datasets, t_offset=None, ms_to_idx=index)
    stream = ColumnStream(path, DSEC)
    for millisecond in range(12):
        first = next(stream.blocks(1_000_000 * millisecond, Faults()), None)
        expected = 10 if millisecond > 9 else index[millisecond]
        assert (0 if first is None else len(first)) == 10 - expected


@pytest.mark.parametrize("index", ["good", "none", "zeros", "short", "huge", "text"])
@pytest.mark.parametrize("seconds", [0.0, 0.123, 0.31, 0.4999, 0.7])
def test_starting_within(
    tmp_path: Path, index: str, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The index only makes it faster; an invalid one is not used."""
    monkeypatch.setattr(hdf5_rows, "BLOCK_ROWS", 100)
    indices = {
        "none": None,
        "zeros": np.zeros(500, np.uint64),
        "short": np.zeros(3, np.uint64),
        "huge": np.full(500, 2**63, np.uint64),
        "text": np.bytes_(b"index"),
    }
    changes = {} if index == "good" else {"ms_to_idx": indices[index]}
    stream = ColumnStream(column_file(tmp_path / "a.h5", LEFT, **changes), DSEC)
    start_ns = START_NS + int(seconds * 1e9)
    parts = list(stream.blocks(start_ns, Faults()))
    ours = EventBlock.concatenate([LEFT[:0], *parts])
    assert_same_events(ours[ours.t_ns >= start_ns], LEFT[LEFT.t_ns >= start_ns])
    assert len(ours) - (LEFT.t_ns >= start_ns).sum() < 50


COLUMN_FAULTS = [
    ({"events/x": None}, "files|not a recording|events/x"),
    ({"events/y": None}, "events/y is missing"),
    ({"events/p": LEFT.polarity[:5]}, "different lengths"),
    ({"events/t": np.bytes_(b"text")}, "events/t is not a column of numbers"),
    ({"events/t": np.zeros((4, 4))}, "events/t is not a column of numbers"),
    ({"t_offset": np.bytes_(b"text")}, "t_offset is not a number"),
    ({f"events/{name}": np.zeros(0, np.uint16) for name in "xytp"}, "holds no events"),
    ({"events/x": np.full(900, 64, np.uint16)}, "900 of 900 events lie outside the 64 x 48 sensor"),
    ({"t_offset": np.int64(10)}, "no time in common"),
]


@pytest.mark.parametrize(("changes", "problem"), COLUMN_FAULTS, ids=range(len(COLUMN_FAULTS)))
def test_faults(tmp_path: Path, calibration: Path, changes: dict, problem: str) -> None:
    column_file(tmp_path / "left.h5", LEFT, **changes)
    column_file(tmp_path / "right.h5", RIGHT)
    with pytest.raises(InputError, match=problem) as caught:
        for _ in open_recording(tmp_path / "left.h5", calibration).event_batches():
            pass
    assert "\n" not in str(caught.value)


def test_events_outside_the_sensor_are_counted(tmp_path: Path, calibration: Path) -> None:
    x = LEFT.x.copy()
    x[[10, 400, 899]] = 700
    column_file(tmp_path / "left.h5", LEFT, **{"events/x": x})
    column_file(tmp_path / "right.h5", RIGHT)
    recording = open_recording(tmp_path, calibration)
    assert_recording_holds(recording, LEFT[np.flatnonzero(x != 700)], RIGHT)
    (line,) = recording.fault_lines()
    assert "3 events outside the sensor were left out" in line


def test_a_camera_that_starts_late_and_stops_early(tmp_path: Path, calibration: Path) -> None:
    left = event_block(900, 5, seconds=3.0)
    right = left[(left.t_ns > START_NS + 10**9) & (left.t_ns < START_NS + 2 * 10**9)]
    column_file(tmp_path / "left.h5", left)
    column_file(tmp_path / "right.h5", right)
    recording = open_recording(tmp_path, calibration)
    assert_recording_holds(recording, left, right)
    late, early = recording.notes
    assert "right camera starts 1.0" in late and "right camera stops" in early


def test_the_other_file_is_missing(tmp_path: Path, calibration: Path) -> None:
    path = column_file(tmp_path / "left.h5", LEFT)
    for place in (path, tmp_path):
        with pytest.raises(InputError, match=r"two cameras|one camera"):
            open_recording(place, calibration)
    column_file(tmp_path / "b.h5", RIGHT)
    with pytest.raises(InputError, match=r"--left-topic b\.h5 --right-topic left\.h5"):
        open_recording(tmp_path, calibration)
    assert_recording_holds(open_recording(tmp_path, calibration, "left.h5", "b.h5"), LEFT, RIGHT)


def test_the_last_word_of_a_name_tells_the_camera(tmp_path: Path, calibration: Path) -> None:
    """A turn to the left and one to the right, recorded by two cameras each."""
    others = event_block(700, 8), event_block(600, 9)
    for name, blocks in (("left_turn_{side}.h5", (LEFT, RIGHT)), ("right_turn_{side}.h5", others)):
        paths = [tmp_path / name.format(side=side) for side in ("left", "right")]
        for path, block in zip(paths, blocks, strict=True):
            column_file(path, block)
    for side in ("left", "right"):
        first = open_recording(tmp_path / f"left_turn_{side}.h5", calibration)
        assert_recording_holds(first, LEFT, RIGHT)
        second = open_recording(tmp_path / f"right_turn_{side}.h5", calibration)
        assert_recording_holds(second, *others)


def test_other_files_in_the_folder(tmp_path: Path, calibration: Path) -> None:
    """A broken file or other tables beside a recording do not keep it from being read."""
    column_file(tmp_path / "LEFT.H5", LEFT)
    column_file(tmp_path / "RIGHT.H5", RIGHT)
    broken = tmp_path / "broken.h5"
    broken.write_bytes((tmp_path / "LEFT.H5").read_bytes()[:1000])
    (tmp_path / "truth.txt").write_text("timestamp x y z qx qy qz qw\n1.5 1 2 3 0 0 0 1\n")
    for place in (tmp_path, tmp_path / "LEFT.H5"):
        assert_recording_holds(open_recording(place, calibration), LEFT, RIGHT)
    (tmp_path / "LEFT.H5").rename(tmp_path / "other.dat")
    with pytest.raises(InputError, match=r"broken\.h5: this HDF5 file is cut short"):
        open_recording(tmp_path, calibration)
    (tmp_path / "RIGHT.H5").unlink()
    broken.unlink()
    with pytest.raises(InputError, match=r"truth\.txt: no column is polarity"):
        open_recording(tmp_path, calibration)


def test_rectify_map_of_another_camera(tmp_path: Path, calibration: Path) -> None:
    files = pair_of_files(tmp_path, NAMES["DSEC"])
    rig = read_calibration(calibration)
    for path, table in zip(files, rig.tables, strict=True):
        with h5py.File(path.with_name("rectify_map.h5"), "w") as file:
            file["rectify_map"] = table
    assert_recording_holds(open_recording(tmp_path, calibration), LEFT, RIGHT)
    with h5py.File(files[1].with_name("rectify_map.h5"), "a") as file:
        file["rectify_map"][:] += 3.0
    with pytest.raises(InputError, match="rectify_map differs from the calibration by 4"):
        open_recording(tmp_path, calibration)


PACKINGS: dict[int, Callable[[bytes], bytes]] = {
    0: bytes,
    1: lz4.frame.compress,
    2: partial(lz4.frame.compress, compression_level=9),
    3: zstandard.compress,
    4: partial(zstandard.compress, level=19),
}


def aedat4_file(path: Path, blocks: dict[str, EventBlock], packing: int = 1) -> Path:
    """Write packets of 100 events of every stream; `packing` is the number of the compression."""
    fields = {"width": WIDTH, "height": HEIGHT}
    streams = [STREAM.format(number=n, name=name, **fields) for n, name in enumerate(blocks)]
    header = io_header(HEADER.format(streams="".join(streams)), packing)
    packets = [
        struct.pack("<ii", number, len(data)) + data
        for number, block in enumerate(blocks.values())
        for first in range(0, len(block), 100)
        for data in [PACKINGS[packing](event_packet(block[first : first + 100]))]
    ]
    path.write_bytes(MAGIC + header + b"".join(packets))
    return path


@pytest.mark.parametrize("packing", PACKINGS)
def test_aedat4_packings(tmp_path: Path, calibration: Path, packing: int) -> None:
    path = aedat4_file(tmp_path / "a.aedat4", {"left": LEFT, "right": RIGHT}, packing)
    assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


def test_aedat4_of_one_camera_each(tmp_path: Path, calibration: Path) -> None:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        aedat4_file(tmp_path / f"{side}.aedat4", {f"DAVIS346_{side}": block})
    for path in (tmp_path, tmp_path / "left.aedat4", tmp_path / "right.aedat4"):
        assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


def test_aedat4_streams_that_are_named_by_serial_numbers(tmp_path: Path, calibration: Path) -> None:
    path = aedat4_file(tmp_path / "a.aedat4", {"DAVIS_7": LEFT, "DAVIS_3": RIGHT})
    with pytest.raises(InputError, match="--left-topic DAVIS_3 --right-topic DAVIS_7"):
        open_recording(path, calibration)
    assert_recording_holds(open_recording(path, calibration, "DAVIS_7", "DAVIS_3"), LEFT, RIGHT)


@pytest.mark.parametrize(
    ("name", "size", "count"),
    [("davis346", (346, 260), 78_830), ("tonic_sample", (320, 240), 111_954)],
)
def test_real_aedat4(shared: Path, name: str, size: tuple[int, int], count: int) -> None:
    file = Aedat4(shared / f"real/reader_samples/{name}.aedat4")
    (camera,) = file.sensors
    stream = Aedat4Stream(file, camera)
    events = read_stream(stream)
    assert stream.resolution == size and len(events) == count
    assert (np.diff(events.t_ns) >= 0).all()
    assert events.x.max() == size[0] - 1 and events.y.max() == size[1] - 1
