"""Recordings of one camera: `gpvo info` and `gpvo convert` read them, `gpvo run` refuses them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from bag_files import event_arrays, types, write_rosbag1
from encoders import START_NS, column_file, event_block, evt2_words, raw_file, shifted, text_file
from reading import assert_same_events, read_recording
from recording_files import HEIGHT, WIDTH
from test_info import invoke

from gpvo.commands.info import open_for_info
from gpvo.errors import InputError
from gpvo.recordings import Recording, open_recording
from gpvo.recordings.base import StereoEvents
from gpvo.recordings.files.aedat4 import Aedat4
from gpvo.recordings.pairing import NO_CAMERA
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.convert import WRITERS, convert

ONE = shifted(event_block(5000, 1), -START_NS)
"""From 0 on: the only time that all formats keep."""
OTHER = shifted(event_block(1500, 2), -START_NS)


def mono_mvsec(path: Path, side: str) -> Path:
    with h5py.File(path, "w") as file:
        rows = [ONE.x, ONE.y, ONE.t_ns / 1e9, np.where(ONE.polarity, 1.0, -1.0)]
        file[f"davis/{side}/events"] = np.column_stack(rows)
    return path


def mono_m3ed(path: Path, side: str, block: EventBlock = ONE) -> Path:
    with h5py.File(path, "a") as file:
        t = block.t_ns // 1000
        for name, column in zip("xytp", (block.x, block.y, t, block.polarity), strict=True):
            file[f"prophesee/{side}/{name}"] = column
        file[f"prophesee/{side}/calib/resolution"] = [WIDTH, HEIGHT]
    return path


def mono_bag(path: Path) -> Path:
    return write_rosbag1(path, event_arrays(types(True), "/dvs/events", ONE, True))


FILES: dict[str, Callable[[Path], Path]] = {
    "raw": lambda folder: raw_file(folder / "a.raw", evt2_words(ONE)),
    "text": lambda folder: text_file(folder / "a.txt", shifted(ONE, START_NS)),
    "columns": lambda folder: column_file(folder / "a.h5", ONE),
    "bag": lambda folder: mono_bag(folder / "a.bag"),
    "left of MVSEC": lambda folder: mono_mvsec(folder / "a_data.hdf5", "left"),
    "left of M3ED": lambda folder: mono_m3ed(folder / "a.h5", "left"),
    "right of M3ED": lambda folder: mono_m3ed(folder / "a.h5", "right"),
    "right of MVSEC": lambda folder: mono_mvsec(folder / "a_data.hdf5", "right"),
}


def events_of(recording: Recording) -> EventBlock:
    assert len(recording.sides) == 1
    both = read_recording(recording)
    assert len(both[recording.sides[0] == "left"]) == 0
    return both[recording.sides[0] != "left"]


@pytest.mark.parametrize("kind", FILES)
def test_info_reads_one_camera(tmp_path: Path, kind: str) -> None:
    path = FILES[kind](tmp_path)
    output = invoke("info", path)
    assert output.count("5,000") == 1 and "holds one camera; gpvo needs two to run" in output
    opened, calibrated = open_for_info(path, None, None, None)
    assert not calibrated
    assert_same_events(events_of(opened), ONE)


@pytest.mark.parametrize("kind", FILES)
def test_one_camera_is_not_run(tmp_path: Path, calibration: Path, kind: str) -> None:
    path = FILES[kind](tmp_path)
    for right in (None, NO_CAMERA):
        with pytest.raises(InputError) as caught:
            open_recording(path, calibration, None, right)
        assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", WRITERS)
def test_one_camera_is_converted(tmp_path: Path, kind: str) -> None:
    source, _ = open_for_info(FILES["raw"](tmp_path / "source"), None, None, None)
    output = tmp_path / ("a" if kind in ("dsec", "raw", "text", "csv") else f"a.{kind}")
    assert convert(source, output, kind) == (5000,)
    converted, _ = open_for_info(output, None, None, None)
    assert_same_events(events_of(converted), ONE if kind != "raw" else shifted(ONE, -ONE.t_ns[0]))


def test_one_of_two_cameras(tmp_path: Path) -> None:
    """As --left-topic names it, with --right-topic none."""
    store = types(True)
    messages = event_arrays(store, "/a/events", ONE, True)
    path = write_rosbag1(
        tmp_path / "a.bag", [*messages, *event_arrays(store, "/b/events", OTHER, True)]
    )
    output = invoke("info", path, "--left-topic", "/b/events", "--right-topic", "none")
    assert "1,500" in output and "5,000" not in output
    with pytest.raises(
        InputError, match="which topic is the camera\\? choose --left-topic /a/events"
    ):
        invoke("info", path, "--right-topic", "none")


def test_topics_choose_tables_of_mvsec(tmp_path: Path, calibration: Path) -> None:
    with h5py.File(mono_mvsec(tmp_path / "a_data.hdf5", "left"), "a") as file:
        file["davis/right/events"] = file["davis/left/events"][:1500]
    left, right = "davis/left/events", "davis/right/events"
    path = tmp_path / "a_data.hdf5"
    for topics, counts in (((left, None), [5000, 1500]), ((None, left), [1500, 5000])):
        opened = read_recording(open_recording(path, calibration, *topics))
        assert [len(side) for side in opened] == counts
    for name, count in ((left, "5,000"), (right, "1,500")):
        topics = ["--left-topic", name, "--right-topic", "none"]
        output = invoke("info", path, "--calibration", calibration, *topics)
        assert output.count(count) == 1 and "holds one camera" in output
    with pytest.raises(InputError, match=f"has no dataset davis; it has {left}, {right}"):
        open_recording(path, calibration, "davis")
    with pytest.raises(InputError, match="which dataset is the camera"):
        invoke("info", path, "--right-topic", "none")


def test_one_of_both_cameras_of_m3ed(tmp_path: Path, calibration: Path) -> None:
    path = mono_m3ed(mono_m3ed(tmp_path / "a.h5", "left"), "right", OTHER)
    for side, count in (("left", "5,000"), ("right", "1,500")):
        topics = ["--left-topic", side, "--right-topic", "none"]
        output = invoke("info", path, "--calibration", calibration, *topics)
        assert count in output and "holds one camera" in output and f"│ {side}" in output
    with pytest.raises(InputError, match="has no camera davis; it has left, right"):
        open_recording(path, calibration, "davis")
    with pytest.raises(InputError, match="names left and right itself"):
        open_recording(path, calibration, "right", "left")


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_camera_of_m3ed_is_converted(tmp_path: Path, side: str) -> None:
    path, output = mono_m3ed(tmp_path / "a.h5", side), tmp_path / "out.aedat4"
    assert "5,000 events" in invoke("convert", path, output)
    converted, _ = open_for_info(output, None, None, None)
    assert_same_events(events_of(converted), ONE)


@pytest.mark.parametrize("name", ["first.raw", None])
def test_info_of_a_single_file_says_what_is_true(tmp_path: Path, name: str | None) -> None:
    """Another file in the folder is not taken for the other camera unless it is named."""
    path = raw_file(tmp_path / "first.raw", evt2_words(ONE))
    raw_file(tmp_path / "elsewhere.raw", evt2_words(OTHER))
    topic = ["--left-topic", name] if name else []
    output = invoke("info", path, *topic)
    assert "5,000" in output and "1,500" not in output and "holds one camera" in output
    both = invoke("info", path, "--left-topic", "first.raw", "--right-topic", "elsewhere.raw")
    assert "5,000" in both and "1,500" in both and "holds one camera" not in both
    with pytest.raises(InputError, match=f"{tmp_path}: has no file davis; it has elsewhere.raw"):
        invoke("info", path, "--left-topic", "davis")


def test_a_single_stream_may_be_named(tmp_path: Path) -> None:
    source, _ = open_for_info(FILES["raw"](tmp_path / "source"), None, None, None)
    convert(source, tmp_path / "a.aedat4")
    output = invoke("info", tmp_path / "a.aedat4", "--left-topic", "left")
    assert "5,000" in output and "holds one camera" in output


def test_aedat4_has_sizes_without_a_calibration(tmp_path: Path) -> None:
    """The file's own, or the smallest that hold all events."""
    for kind in ("raw", "text"):
        source, _ = open_for_info(FILES[kind](tmp_path / kind), None, None, None)
        convert(source, tmp_path / f"{kind}.aedat4")
        (sensor,) = Aedat4(tmp_path / f"{kind}.aedat4").sensors.values()
        assert sensor.resolution == (WIDTH, HEIGHT)


def test_batches_of_one_camera_cover_the_same_time(tmp_path: Path) -> None:
    opened, _ = open_for_info(FILES["raw"](tmp_path), None, None, None)
    batches: list[StereoEvents] = list(opened.event_batches(0.1, 0.3))
    assert batches[0].start == 0.1 and batches[-1].stop == 0.3
    inside = (ONE.t_ns - ONE.t_ns[0] >= 1e8) & (ONE.t_ns - ONE.t_ns[0] < 3e8)
    assert sum(len(batch.left) for batch in batches) == inside.sum()
