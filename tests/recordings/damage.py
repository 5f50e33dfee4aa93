"""Damage small files of every format at random, and classify how they are read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bag_files import event_packets, types, write_rosbag1, write_rosbag2
from encoders import (
    column_file,
    event_block,
    evt2_words,
    evt3_words,
    evt21_words,
    raw_file,
    text_file,
)
from reading import read_recording
from rosbags.rosbag2 import StoragePlugin

from gpvo.errors import InputError
from gpvo.recordings import open_recording
from gpvo.recordings.stereo import StreamRecording
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.convert import convert

COUNT = 800


@dataclass(frozen=True)
class Sample:
    """Recording to open, and which of its files is damaged."""

    path: Path
    damaged: Path
    calibration: Path


def _bag_of_packets(folder: Path, blocks: tuple[EventBlock, EventBlock], ros1: bool) -> Path:
    store = types(ros1)
    messages = [
        message
        for side, block in zip(("left", "right"), blocks, strict=True)
        for message in event_packets(
            store, f"/{side}/events", block, ros1, "evt3", lambda part, base: evt3_words(part)
        )
    ]
    if ros1:
        return write_rosbag1(folder / "packets.bag", messages, chunk=3000)
    written = write_rosbag2(folder / "bag2", messages, StoragePlugin.SQLITE3)
    return next(written.glob("*.db3"))


def samples(folder: Path, calibration: Path) -> dict[str, Sample]:
    """Write two cameras in every format; the first part of a name is the format."""
    blocks = event_block(COUNT, 1), event_block(COUNT, 2)
    source = folder / "dsec"
    for side, block in zip(("left", "right"), blocks, strict=True):
        column_file(source / f"{side}.h5", block)
        raw_file(folder / f"raw3_{side}.raw", evt3_words(block))
        raw_file(folder / f"raw2_{side}.raw", evt2_words(block))
        raw_file(folder / f"raw21_{side}.raw", evt21_words(block))
        text_file(folder / f"text_{side}.txt", block)
    recording = open_recording(source, calibration)
    for name in ("a.bag", "b.mcap", "c.aedat4"):
        convert(recording, folder / name)
    paths = {
        "dsec": source / "left.h5",
        "rosbag1": folder / "a.bag",
        "mcap": folder / "b.mcap",
        "aedat4": folder / "c.aedat4",
        "raw evt3": folder / "raw3_left.raw",
        "raw evt2": folder / "raw2_left.raw",
        "raw evt2.1": folder / "raw21_left.raw",
        "text": folder / "text_left.txt",
        "rosbag1 packets": _bag_of_packets(folder, blocks, True),
        "rosbag2 packets": _bag_of_packets(folder, blocks, False),
    }
    return {name: Sample(path, path, calibration) for name, path in paths.items()}


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the first part of a file."""
    return data[: int(rng.integers(0, len(data)))]


def flip(data: bytes, rng: np.random.Generator) -> bytes:
    """Replace a few bytes by others."""
    changed = bytearray(data)
    for at in rng.integers(0, len(data), int(rng.integers(1, 9))):
        changed[at] = int(rng.integers(0, 256))
    return bytes(changed)


def blank(data: bytes, rng: np.random.Generator) -> bytes:
    """Replace a stretch by zeros, as a failing disk does."""
    at = int(rng.integers(0, len(data)))
    size = int(rng.integers(1, 400))
    return data[:at] + bytes(len(data[at : at + size])) + data[at + size :]


DAMAGES: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (cut, flip, blank)


def outcome(sample: Sample, expected: tuple[EventBlock, EventBlock], only_cut: bool) -> str:
    """Read a damaged file; return "error", "whole", or whether losses are "told" or "untold".

    Raises
    ------
    AssertionError
        If batches are not in time order, an error is not a single line that names a file, or a
        file that was only cut gives events that were never written.
    """
    try:
        recording = open_recording(sample.path, sample.calibration)
        ours = read_recording(recording)
    except InputError as error:
        message = str(error)
        assert "\n" not in message and str(sample.damaged.parent) in message, message
        return "error"
    for block in ours:
        assert (np.diff(block.t_ns) >= 0).all()
    if only_cut:
        assert not any(
            _missing(block, theirs) for theirs, block in zip(expected, ours, strict=True)
        )
    lost = sum(_missing(theirs, block) for theirs, block in zip(expected, ours, strict=True))
    if not lost:
        return "whole"
    assert isinstance(recording, StreamRecording)
    return "told" if recording.notes or recording.fault_lines() else "untold"


def _missing(theirs: EventBlock, ours: EventBlock) -> int:
    """Return how many of the written events were not read."""
    return sum((Counter(_rows(theirs)) - Counter(_rows(ours))).values())


def _rows(block: EventBlock) -> list[tuple]:
    columns = (block.x, block.y, block.t_ns, block.polarity)
    return list(zip(*(column.tolist() for column in columns), strict=True))
