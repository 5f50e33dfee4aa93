"""Small encoders of the cameras' byte streams and files, for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np
from recording_files import HEIGHT, WIDTH

from gpvo.recordings.streams import EventBlock

START_NS = 1_500_000_000_123_456_000
"""Whole microseconds."""


def event_block(
    count: int, seed: int = 0, start_ns: int = START_NS, seconds: float = 0.5
) -> EventBlock:
    """Return random events in time order, with whole microseconds."""
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(0, int(seconds * 1e6), count))
    return EventBlock(
        rng.integers(0, WIDTH, count).astype(np.uint16),
        rng.integers(0, HEIGHT, count).astype(np.uint16),
        start_ns + 1000 * t_us,
        rng.integers(0, 2, count).astype(bool),
    )


def shifted(block: EventBlock, shift_ns: int) -> EventBlock:
    return EventBlock(block.x, block.y, block.t_ns + shift_ns, block.polarity)


def evt3_words(block: EventBlock, vectors: bool = False) -> np.ndarray:
    """Encode ordered events as EVT3, times modulo 16.777 s; with `vectors`, runs as VECT_12."""
    words: list[int] = []
    last_high, last_low, last_y = -1, -1, -1
    index = 0
    while index < len(block):
        t_us = int(block.t_ns[index]) // 1000
        high, low, y = t_us >> 12 & 0xFFF, t_us & 0xFFF, int(block.y[index])
        if high != last_high:
            words.append(0x8000 | high)
            low_known = False
            last_high = high
        else:
            low_known = low == last_low
        if not low_known:
            words.append(0x6000 | low)
            last_low = low
        if y != last_y:
            words.append(y)
            last_y = y
        run = _run(block, index) if vectors else []
        x, polarity = int(block.x[index]), int(block.polarity[index])
        if len(run) > 1:
            words.append(0x3000 | polarity << 11 | x)
            words.append(0x4000 | sum(1 << int(block.x[i]) - x for i in run))
            index += len(run)
        else:
            words.append(0x2000 | polarity << 11 | x)
            index += 1
    return np.array(words, "<u2")


def _run(block: EventBlock, first: int, columns: int = 12) -> list[int]:
    """Return the events from `first` on of one time, row and polarity, rightwards in `columns`."""
    run = [first]
    for index in range(first + 1, len(block)):
        same = all(
            getattr(block, name)[index] == getattr(block, name)[first]
            for name in ("t_ns", "y", "polarity")
        )
        x, previous = int(block.x[index]), int(block.x[run[-1]])
        if not (same and previous < x < int(block.x[first]) + columns):
            break
        run.append(index)
    return run


def evt2_words(block: EventBlock) -> np.ndarray:
    """Encode ordered events as EVT2."""
    words: list[int] = []
    last_high = -1
    for x, y, t_ns, polarity in zip(block.x, block.y, block.t_ns, block.polarity, strict=True):
        t_us = int(t_ns) // 1000
        if t_us >> 6 != last_high:
            last_high = t_us >> 6
            words.append(0x8 << 28 | last_high & 0xFFFFFFF)
        words.append(int(polarity) << 28 | (t_us & 0x3F) << 22 | int(x) << 11 | int(y))
    return np.array(words, "<u4")


def evt21_words(block: EventBlock, legacy: bool = False) -> np.ndarray:
    """Encode ordered events as EVT2.1, neighbours of one time, row and polarity in one word."""
    words: list[int] = []
    last_high = -1
    index = 0
    while index < len(block):
        run = _run(block, index, 32)
        x, y, t_us = int(block.x[index]), int(block.y[index]), int(block.t_ns[index]) // 1000
        if t_us >> 6 != last_high:
            last_high = t_us >> 6
            words.append((0x8 << 28 | last_high & 0xFFFFFFF) << 32)
        head = int(block.polarity[index]) << 28 | (t_us & 0x3F) << 22 | x << 11 | y
        words.append(head << 32 | sum(1 << int(block.x[i]) - x for i in run))
        index += len(run)
    ordered = [word >> 32 | (word & 0xFFFFFFFF) << 32 for word in words] if legacy else words
    return np.array(ordered, "<u8")


def raw_file(path: Path, words: np.ndarray, form: str = "") -> Path:
    """Write a Prophesee raw file; `form` is a line of the header that not all files have."""
    version = {2: "3.0", 4: "2.0", 8: "2.1"}[words.itemsize]
    lines = ["date 2026-01-01 00:00:00", f"evt {version}", form, f"geometry {WIDTH}x{HEIGHT}"]
    header = "".join(f"% {line}\n" for line in [*lines, "end"] if line)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(header.encode() + words.tobytes())
    return path


def libcaer_packed_words(block: EventBlock, time_base_ns: int) -> np.ndarray:
    """Encode one packet as libcaer_cmp."""
    words = []
    for x, y, t_ns, polarity in zip(block.x, block.y, block.t_ns, block.polarity, strict=True):
        t_us = (int(t_ns) - time_base_ns) // 1000
        words += [t_us >> 12, 0x1000 | t_us & 0xFFF, 0x2000 | int(x)]
        words.append(0x3000 | int(polarity) << 11 | int(y))
    return np.array(words, "<u2")


def libcaer_records(block: EventBlock, time_base_ns: int) -> np.ndarray:
    """Encode one packet as libcaer."""
    records = np.zeros(len(block), [("data", "<u4"), ("ts", "<i4")])
    x, y = block.x.astype(np.uint32), block.y.astype(np.uint32)
    records["data"] = x << 17 | y << 2 | block.polarity.astype(np.uint32) << 1 | 1
    records["ts"] = (block.t_ns - time_base_ns) // 1000
    return records


def mono_records(block: EventBlock, time_base_ns: int) -> np.ndarray:
    """Encode one packet as the 8-byte records of `mono`."""
    parts = [block.t_ns - time_base_ns, block.x, block.y, block.polarity]
    dt, x, y, polarity = (np.asarray(part).astype(np.uint64) for part in parts)
    bits = dt | x << np.uint64(32) | y << np.uint64(48) | polarity << np.uint64(63)
    return bits.astype("<u8")


def column_file(path: Path, block: EventBlock, **changes: Any) -> Path:
    """Write a file in DSEC's layout; `changes` replace datasets, None leaves one out."""
    offset_us = int(block.t_ns[0]) // 1000 - 5
    t = block.t_ns // 1000 - offset_us
    datasets: dict[str, Any] = {
        "events/x": block.x,
        "events/y": block.y,
        "events/t": t.astype(np.uint32),
        "events/p": block.polarity.astype(np.uint8),
        "t_offset": np.int64(offset_us),
        "ms_to_idx": np.searchsorted(t, 1000 * np.arange(t[-1] // 1000 + 1)).astype(np.uint64),
    } | changes
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for name, data in datasets.items():
            if data is not None:
                packed = hdf5plugin.Blosc(cname="zstd") if np.ndim(data) else {}
                file.create_dataset(name, data=data, **packed)
    return path


def text_file(path: Path, block: EventBlock) -> Path:
    """Write lines of `t x y polarity`, with seconds from zero."""
    seconds = (block.t_ns - START_NS) / 1e9
    lines = [
        f"{t:.9f} {x} {y} {int(polarity)}"
        for t, x, y, polarity in zip(seconds, block.x, block.y, block.polarity, strict=True)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path
