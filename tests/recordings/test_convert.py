"""Converted recordings give us and other libraries the same events to the microsecond."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
from bag_files import types
from encoders import START_NS, column_file, event_block, shifted
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from reading import assert_recording_holds
from recording_files import HEIGHT, WIDTH
from rosbags.highlevel import AnyReader

from gpvo.errors import InputError, OutputError
from gpvo.recordings import Recording, open_recording
from gpvo.recordings.files.text_layout import text_layout
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.bags import cdr_event_array, ros1_event_array
from gpvo.recordings.writing.convert import WRITERS, convert
from gpvo.recordings.writing.raw import RawWriter
from gpvo.recordings.writing.writer import microseconds

OUTPUTS = {
    "mvsec": "a_data.hdf5",
    "rosbag1": "a.bag",
    "mcap": "a.mcap",
    "aedat4": "a.aedat4",
    "dsec": "a",
    "raw": "a_raw",
    "text": "a_text",
    "csv": "a_csv",
}
LEFT, RIGHT = event_block(2000, 1), event_block(1500, 2)


@pytest.fixture
def recording(tmp_path: Path, calibration: Path) -> Recording:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        column_file(tmp_path / f"source/{side}.h5", block)
    return open_recording(tmp_path / "source", calibration)


KINDS = tuple(WRITERS)


@pytest.mark.parametrize(("kind", "second"), list(zip(KINDS, (*KINDS[1:], KINDS[0]), strict=True)))
def test_round_trips(tmp_path: Path, recording: Recording, kind: str, second: str) -> None:
    """Two formats in a row, recognised by their content, each with its calibration beside it."""
    first = tmp_path / "first" / OUTPUTS[kind]
    assert convert(recording, first, kind) == (2000, 1500)
    again = tmp_path / "second" / OUTPUTS[second]
    assert convert(open_recording(first), again, second) == (2000, 1500)
    converted = open_recording(again)
    # Raw files begin at 0.
    begin = -min(LEFT.t_ns[0], RIGHT.t_ns[0]) if "raw" in (kind, second) else 0
    expected = shifted(LEFT, begin), shifted(RIGHT, begin)
    # MVSEC's float64 seconds since 1970 resolve a quarter of a microsecond.
    assert_recording_holds(converted, *expected, 500 if "mvsec" in (kind, second) else 0)
    for rows in (LEFT, RIGHT):
        assert (microseconds(rows.t_ns) * 1000 == rows.t_ns).all()
    np.testing.assert_array_equal(converted.rig.tables, recording.rig.tables)
    assert not list(tmp_path.glob("*/*.part"))


@pytest.mark.parametrize("kind", ["text", "csv"])
def test_text_names_its_columns_and_their_unit(
    tmp_path: Path, recording: Recording, kind: str
) -> None:
    convert(recording, tmp_path / "a", kind)
    (left,) = (tmp_path / "a").glob("left.*")
    layout = text_layout(left)
    assert layout is not None and layout.is_named


def test_outputs_that_cannot_be(tmp_path: Path, recording: Recording) -> None:
    with pytest.raises(InputError, match="which format"):
        convert(recording, tmp_path / "a.xyz")
    with pytest.raises(InputError, match="--to rosbag3: is unknown; choose one of mvsec"):
        convert(recording, tmp_path / "a.bag", "rosbag3")
    (tmp_path / "a.bag").write_text("precious")
    with pytest.raises(InputError, match="exists"):
        convert(recording, tmp_path / "a.bag")
    assert (tmp_path / "a.bag").read_text() == "precious"
    with pytest.raises(InputError, match="cannot be written"):
        convert(recording, tmp_path / "a.bag/b.mcap")


@contextmanager
def full_disk(room: int) -> Iterator[None]:
    """Let no file grow beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("room", [100, 8000])
@pytest.mark.parametrize("kind", WRITERS)
def test_a_full_disk_is_one_line(
    tmp_path: Path, recording: Recording, kind: str, room: int
) -> None:
    """HDF5 crashes the process where it cannot write what it holds."""
    output = tmp_path / "out" / OUTPUTS[kind]
    problem = r"cannot be written \(File too large\); nothing was saved"
    with full_disk(room), pytest.raises(OutputError, match=problem):
        convert(recording, output, kind)
    assert not list((tmp_path / "out").iterdir())


def test_raw_has_limits(tmp_path: Path, calibration: Path) -> None:
    wide = EventBlock(np.full(3, 2048, "u2"), *(np.zeros(3, kind) for kind in ("u2", "i8", "?")))
    long = EventBlock(*(np.zeros(2, "u2"),) * 2, np.array([0, 1 << 44]), np.zeros(2, bool))
    for block, problem in ((wide, "pixels up to 2047, not 2048"), (long, "4.8 hours")):
        writer = RawWriter(tmp_path / problem, ((0, 0),), 0)
        with writer, pytest.raises(InputError, match=f"--to raw: EVT2 has {problem}"):
            writer.append(block)


def test_csv_that_pandas_reads(tmp_path: Path, recording: Recording) -> None:
    pandas = pytest.importorskip("pandas")
    convert(recording, tmp_path / "a", "csv")
    table = pandas.read_csv(tmp_path / "a/right.csv")
    assert list(table.columns) == ["t[us]", "x", "y", "polarity"]
    np.testing.assert_array_equal(table["t[us]"] * 1000, RIGHT.t_ns)
    np.testing.assert_array_equal(
        table[["x", "y", "polarity"]].T, [RIGHT.x, RIGHT.y, RIGHT.polarity]
    )


def test_aedat4_that_dv_reads(tmp_path: Path, recording: Recording) -> None:
    dv = pytest.importorskip("dv_processing", reason="needs pip install dv-processing")
    convert(recording, tmp_path / "a.aedat4")
    reader = dv.io.StereoCameraRecording(str(tmp_path / "a.aedat4"), "left", "right")
    for side, block in ((reader.getLeftReader(), LEFT), (reader.getRightReader(), RIGHT)):
        assert side.getEventResolution() == (WIDTH, HEIGHT)
        events = side.getNextEventBatch().numpy()
        np.testing.assert_array_equal(events["timestamp"] * 1000, block.t_ns[: len(events)])


def test_the_ending_is_not_needed(tmp_path: Path, recording: Recording) -> None:
    convert(recording, tmp_path / "out/b.events", "aedat4")
    assert_recording_holds(open_recording(tmp_path / "out/b.events"), LEFT, RIGHT)


@settings(deadline=None, max_examples=30)
@given(count=st.integers(1, 40), seed=st.integers(0, 99), ros1=st.booleans())
def test_messages_that_rosbags_reads(count: int, seed: int, ros1: bool) -> None:
    block, store = event_block(count, seed), types(ros1)
    if ros1:
        raw = ros1_event_array(block, (WIDTH, HEIGHT))
        message = store.deserialize_ros1(raw, "dvs_msgs/msg/EventArray")
        assert store.serialize_ros1(message, "dvs_msgs/msg/EventArray") == raw
    else:
        raw = cdr_event_array(block, (WIDTH, HEIGHT))
        message = store.deserialize_cdr(raw, "dvs_msgs/msg/EventArray")
    assert (message.width, message.height) == (WIDTH, HEIGHT)
    assert [(e.x, e.y, e.ts.sec * 10**9 + e.ts.nanosec, e.polarity) for e in message.events] == [
        (x, y, t, p)
        for x, y, t, p in zip(block.x, block.y, block.t_ns, block.polarity, strict=True)
    ]


@pytest.mark.parametrize("name", ["a.bag", "a.mcap"])
def test_bags_that_rosbags_reads(tmp_path: Path, recording: Recording, name: str) -> None:
    convert(recording, tmp_path / name)
    counts = dict.fromkeys(("/davis/left/events", "/davis/right/events"), 0)
    if name == "a.mcap":
        store = types(False)
        with (tmp_path / name).open("rb") as file:
            for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                event_array = store.deserialize_cdr(message.data, "dvs_msgs/msg/EventArray")
                counts[channel.topic] += len(event_array.events)
    else:
        with AnyReader([tmp_path / name]) as reader:
            for connection, _, raw in reader.messages():
                counts[connection.topic] += len(reader.deserialize(raw, connection.msgtype).events)
    assert list(counts.values()) == [2000, 1500]


def test_aedat4_that_others_read(tmp_path: Path, recording: Recording) -> None:
    aedat = pytest.importorskip("aedat", reason="needs pip install aedat")
    convert(recording, tmp_path / "a.aedat4")
    decoder = aedat.Decoder(str(tmp_path / "a.aedat4"))
    streams = decoder.id_to_stream()
    assert {number: one["width"] for number, one in streams.items()} == {0: WIDTH, 1: WIDTH}
    packets: dict[int, list] = {0: [], 1: []}
    for packet in decoder:
        packets[packet["stream_id"]].append(packet["events"])
    for number, block in enumerate((LEFT, RIGHT)):
        events = np.concatenate(packets[number])
        np.testing.assert_array_equal(events["t"] * 1000, block.t_ns)
        np.testing.assert_array_equal(events["x"], block.x)
        np.testing.assert_array_equal(events["y"], block.y)
        np.testing.assert_array_equal(events["on"], block.polarity)


def test_recordings_longer_than_uint32_microseconds(tmp_path: Path, calibration: Path) -> None:
    """Recordings may be longer than 71 minutes."""
    late = shifted(event_block(50, 3), 3 * 10**12)
    for side in ("left", "right"):
        block = EventBlock.concatenate([event_block(50, 4), late])
        t = (block.t_ns - START_NS) // 1000
        changes = {"events/t": t, "ms_to_idx": None, "t_offset": np.int64(START_NS // 1000)}
        column_file(tmp_path / f"{side}.h5", block, **changes)
    recording = open_recording(tmp_path, calibration)
    recording.batch_length = 100.0  # type: ignore[attr-defined]
    assert_recording_holds(recording, block, block)


def test_mvsec_needs_no_filter_but_h5py_s_own(tmp_path: Path, recording: Recording) -> None:
    convert(recording, tmp_path / "a.hdf5")
    with h5py.File(tmp_path / "a.hdf5") as file:
        for table in (file["davis/left/events"], file["davis/right/events"]):
            filters = table.id.get_create_plist()
            kinds = [filters.get_filter(number)[0] for number in range(filters.get_nfilters())]
            assert set(kinds) <= {h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE}
