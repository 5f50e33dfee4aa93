"""Bags of every kind, written by other libraries one event at a time, give the same events."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zstandard
from bag_files import event_arrays, event_packets, types, write_rosbag1, write_rosbag2
from encoders import (
    START_NS,
    event_block,
    evt3_words,
    libcaer_packed_words,
    libcaer_records,
    mono_records,
    shifted,
)
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from reading import assert_recording_holds, read_stream
from recording_files import HEIGHT, WIDTH
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin

from gpvo.errors import InputError
from gpvo.recordings import open_recording
from gpvo.recordings.bags.rosbag1 import RosBag1
from gpvo.recordings.bags.topics import event_topics, topic_stream
from gpvo.recordings.decoders.evt3 import WRAP_US
from gpvo.recordings.streams import EventBlock

LEFT, RIGHT = event_block(700, 1), event_block(500, 2)
WRAP_NS = WRAP_US * 1000
TOPICS = ("/davis/left/events", "/davis/right/events")


def arrays(ros1: bool, package: str = "dvs_msgs", topics: tuple[str, str] = TOPICS) -> list:
    store = types(ros1)
    return [
        message
        for topic, block in zip(topics, (LEFT, RIGHT), strict=True)
        for message in event_arrays(store, topic, block, ros1, package)
    ]


@pytest.mark.parametrize(
    ("package", "compression"),
    [
        ("dvs_msgs", None),
        ("prophesee_event_msgs", Writer1.CompressionFormat.BZ2),
        ("dv_ros_msgs", Writer1.CompressionFormat.LZ4),
    ],
)
def test_rosbag1(tmp_path: Path, calibration: Path, package: str, compression: object) -> None:
    path = write_rosbag1(tmp_path / "a.bag", arrays(True, package), compression)
    assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_rosbag2(tmp_path: Path, calibration: Path, storage: StoragePlugin) -> None:
    folder = write_rosbag2(tmp_path / "bag", arrays(False), storage)
    assert_recording_holds(open_recording(folder, calibration), LEFT, RIGHT)
    (folder / "metadata.yaml").unlink()
    assert_recording_holds(open_recording(folder, calibration), LEFT, RIGHT)
    (file,) = folder.iterdir()
    assert_recording_holds(open_recording(file, calibration), LEFT, RIGHT)


def test_rosbag2_in_two_files(tmp_path: Path, calibration: Path) -> None:
    messages = sorted(arrays(False), key=lambda entry: entry[2])
    folder = tmp_path / "bag"
    folder.mkdir()
    for number, part in enumerate((messages[:6], messages[6:])):
        written = write_rosbag2(tmp_path / str(number), part, StoragePlugin.SQLITE3)
        next(written.glob("*.db3")).rename(folder / f"bag_{number}.db3")
    assert_recording_holds(open_recording(folder, calibration), LEFT, RIGHT)


def test_bags_beside_each_other_are_not_one(tmp_path: Path, calibration: Path) -> None:
    """Files that are no numbered parts are only read as one if each has other cameras."""
    folder, both = tmp_path / "bags", arrays(False)
    folder.mkdir()
    sides = [[one for one in both if one[0] == topic] for topic in TOPICS]
    for name, messages in (("LEFT.MCAP", sides[0]), ("RIGHT.MCAP", sides[1])):
        written = write_rosbag2(tmp_path / name[0], messages, StoragePlugin.MCAP)
        next(written.glob("*.mcap")).rename(folder / name)
    assert_recording_holds(open_recording(folder, calibration), LEFT, RIGHT)
    written = write_rosbag2(tmp_path / "copy", both, StoragePlugin.SQLITE3)
    copy = next(written.glob("*.db3")).rename(folder / "copy_0.db3")
    with pytest.raises(InputError, match=r"several recordings; name one: .*copy_0"):
        open_recording(folder, calibration)
    assert_recording_holds(open_recording(copy, calibration), LEFT, RIGHT)


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_mcap_of_its_own_library(
    tmp_path: Path, calibration: Path, compression: CompressionType, chunked: bool
) -> None:
    """Any language of the schema and any compression are read, with and without chunks."""
    store = types(False)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, 5000, compression, use_chunking=chunked)
        writer.start("ros2", "test")
        schema = writer.register_schema("dvs_msgs/msg/EventArray", "ros2idl", b"no text we know")
        channels = {topic: writer.register_channel(topic, "cdr", schema) for topic in TOPICS}
        for topic, kind, stamp, message in sorted(arrays(False), key=lambda entry: entry[2]):
            raw = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], stamp, raw, stamp)
        writer.finish()
    assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


def test_messages_that_the_recorder_compressed(tmp_path: Path, calibration: Path) -> None:
    folder = write_rosbag2(tmp_path / "bag", arrays(False), StoragePlugin.SQLITE3)
    (path,) = folder.glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT id, data FROM messages").fetchall()
        packed = [(zstandard.compress(data), number) for number, data in rows]
        database.executemany("UPDATE messages SET data = ? WHERE id = ?", packed)
        database.commit()
    assert_recording_holds(open_recording(folder, calibration), LEFT, RIGHT)
    path.rename(path.with_suffix(".db3.zstd"))
    with pytest.raises(InputError, match="unpack it with zstd -d"):
        open_recording(folder, calibration)


ENCODERS: dict[str, Callable] = {
    "evt3": lambda block, base: evt3_words(block),
    "libcaer_cmp": libcaer_packed_words,
    "libcaer": libcaer_records,
    "mono": mono_records,
}


def packets(
    ros1: bool, encoding: str, blocks: tuple = (LEFT, RIGHT), delays: tuple[int, int] = (0, 0)
) -> list:
    store = types(ros1)
    return [
        message
        for topic, block, delay in zip(TOPICS, blocks, delays, strict=True)
        for message in event_packets(
            store, topic, block, ros1, encoding, ENCODERS[encoding], delay_ns=delay
        )
    ]


@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("ros1", [True, False])
def test_event_packets(tmp_path: Path, calibration: Path, encoding: str, ros1: bool) -> None:
    messages = packets(ros1, encoding)
    if ros1:
        path = write_rosbag1(tmp_path / "a.bag", messages)
    else:
        path = write_rosbag2(tmp_path / "bag", messages, StoragePlugin.MCAP)
    # EVT3 is placed by the time of arrival, here that of the first left event.
    assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


def test_an_encoding_that_is_not_read_is_named(tmp_path: Path, calibration: Path) -> None:
    """Also a driver's first packet, which may be empty, is not what tells the others' clock."""
    messages = packets(True, "evt3")
    messages[0][-1].encoding = "evt2"
    recording = open_recording(write_rosbag1(tmp_path / "a.bag", messages), calibration)
    assert abs(recording.start_ns - START_NS) < 10**9
    for *_, message in messages:
        message.encoding = "evt2"
    with pytest.raises(InputError, match="left/events: its packets have the encoding 'evt2'"):
        open_recording(write_rosbag1(tmp_path / "b.bag", messages), calibration)


def test_cameras_that_share_a_clock_keep_it(tmp_path: Path, calibration: Path) -> None:
    """Arrival delays have no effect if the sensors' own stamps agree except for wraps."""
    messages = packets(True, "evt3", delays=(3_000_000, 8_000_000))
    recording = open_recording(write_rosbag1(tmp_path / "a.bag", messages), calibration)
    assert_recording_holds(recording, shifted(LEFT, 3_000_000), shifted(RIGHT, 3_000_000))


def test_wraps_of_one_camera_only(tmp_path: Path, calibration: Path) -> None:
    """The left camera's counter wraps before its first packet, the right one's after its first."""
    start = (START_NS // WRAP_NS + 1) * WRAP_NS + 5_000_000
    left = event_block(300, 3, start)
    right = event_block(400, 4, start - 8_000_000)
    messages = packets(True, "evt3", (left, right))
    recording = open_recording(write_rosbag1(tmp_path / "a.bag", messages), calibration)
    assert_recording_holds(recording, left, right)
    assert any("wraps" in note for note in recording.notes)


def test_clocks_that_are_not_synchronised(tmp_path: Path, calibration: Path) -> None:
    right = shifted(RIGHT, 3_000_000_000)
    messages = packets(True, "evt3", (LEFT, right), (0, -3_000_000_000))
    recording = open_recording(write_rosbag1(tmp_path / "a.bag", messages), calibration)
    assert_recording_holds(recording, LEFT, RIGHT)
    assert any("not synchronised" in note for note in recording.notes)


def test_packets_that_were_lost_for_longer_than_a_wrap(tmp_path: Path, calibration: Path) -> None:
    late = shifted(event_block(300, 5), 40_000_000_000)
    both = EventBlock.concatenate([LEFT, late])
    messages = packets(True, "evt3") + packets(True, "evt3", (late, late))
    right = EventBlock.concatenate([RIGHT, late])
    recording = open_recording(write_rosbag1(tmp_path / "a.bag", messages), calibration)
    assert_recording_holds(recording, both, right)


def test_ambiguous_topics(tmp_path: Path, calibration: Path) -> None:
    path = write_rosbag1(tmp_path / "a.bag", arrays(True, topics=("/front", "/rear")))
    with pytest.raises(InputError) as caught:
        open_recording(path, calibration)
    assert "--left-topic /front --right-topic /rear" in str(caught.value)
    recording = open_recording(path, calibration, "/front", "/rear")
    assert_recording_holds(recording, LEFT, RIGHT)
    assert_recording_holds(open_recording(path, calibration, right_topic="/front"), RIGHT, LEFT)
    with pytest.raises(InputError, match="--left-topic and --right-topic both name /front"):
        open_recording(path, calibration, "/front", "/front")
    with pytest.raises(InputError, match="has no topic /back; it has /front, /rear"):
        open_recording(path, calibration, "/back")


@pytest.mark.parametrize(
    "topics",
    [
        ("/cam0/events", "/cam1/events"),
        ("/dvs/left", "/dvs/right"),
        ("/prophesee/camera_0/cd", "/prophesee/camera_1/cd"),
    ],
)
def test_pairs_of_topics(tmp_path: Path, calibration: Path, topics: tuple[str, str]) -> None:
    path = write_rosbag1(tmp_path / "a.bag", arrays(True, topics=topics))
    assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)


def test_one_camera_or_none(tmp_path: Path, calibration: Path) -> None:
    path = write_rosbag1(tmp_path / "a.bag", [m for m in arrays(True) if m[0] == TOPICS[0]])
    with pytest.raises(InputError, match="two cameras are needed"):
        open_recording(path, calibration)
    store = types(True)
    empty = event_arrays(store, TOPICS[1], LEFT, True)[:1]
    path = write_rosbag1(tmp_path / "b.bag", [*event_arrays(store, TOPICS[0], LEFT, True), *empty])
    with pytest.raises(InputError, match="/davis/right/events: holds no events"):
        open_recording(path, calibration)


def test_camera_info_in_the_bag(tmp_path: Path) -> None:
    store = types(True)
    info, region = (
        store.types[f"sensor_msgs/msg/{name}"] for name in ("CameraInfo", "RegionOfInterest")
    )
    messages = arrays(True)
    for side, offset in (("left", 0.0), ("right", -4.0)):
        K = np.array([40.0, 0, 32, 0, 40, 24, 0, 0, 1])
        P = np.array([40.0, 0, 32, offset, 0, 40, 24, 0, 0, 0, 1, 0])
        head = messages[0][3].header
        lens = ("plumb_bob", np.zeros(5), K, np.eye(3).ravel(), P, 0, 0)
        message = info(head, HEIGHT, WIDTH, *lens, region(0, 0, 0, 0, False))
        messages.append(
            (f"/davis/{side}/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, message)
        )
    recording = open_recording(write_rosbag1(tmp_path / "a.bag", messages))
    assert recording.rig.baseline == pytest.approx(0.1)
    assert recording.rig.focal_length == 40.0
    assert_recording_holds(recording, LEFT, RIGHT)


def test_real_bag_of_event_packets(shared: Path) -> None:
    """The sums are those that event_camera_py's own tests expect."""
    bag = RosBag1(shared / "real/reader_samples/event_camera_py_test_events_1.bag")
    (topic,) = event_topics(bag)
    stream = topic_stream(bag, topic)
    events = read_stream(stream)
    assert stream.resolution == (640, 480)
    assert (int((~events.polarity).sum()), int(events.polarity.sum())) == (218_291, 125_183)
    assert int(events.t_ns[0]) == 7_139_845_000
    assert int(events.t_ns.sum()) == 2_851_601_611_994_000
