"""Write Prophesee's raw files, in EVT2: a file for each camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.recordings.base import SIDES
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.writer import RecordingWriter, Sizes, microseconds

LARGEST_PIXEL = (1 << 11) - 1
LONGEST_US = 1 << 34
"""4.8 hours, after which the clock of EVT2 starts again."""
TIME_HIGH = 0x8 << 28


class RawWriter(RecordingWriter):
    """Writer of a folder with left.raw and right.raw, whose common clock begins at 0.

    Raises
    ------
    InputError
        If a pixel or a time does not fit into EVT2.
    """

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        path.mkdir()
        self._start_us = start_ns // 1000
        self._files = []
        for side, (width, height) in zip(SIDES, sizes, strict=False):
            geometry = f"% geometry {width}x{height}\n" if width and height else ""
            self._files.append((path / f"{side}.raw").open("wb"))
            self._files[-1].write(f"% evt 2.0\n{geometry}% end\n".encode())
        self._high = [-1] * len(sizes)

    def append(self, *blocks: EventBlock) -> None:
        for number, (file, block) in enumerate(zip(self._files, blocks, strict=True)):
            if len(block) == 0:
                continue
            t_us = microseconds(block.t_ns) - self._start_us
            _check(block, t_us)
            file.write(evt2(block, t_us, self._high[number]).tobytes())
            self._high[number] = int(t_us[-1]) >> 6

    def close(self) -> None:
        for file in self._files:
            file.close()


def evt2(block: EventBlock, t_us: NDArray[np.int64], high: int = -1) -> NDArray[np.uint32]:
    """Encode events at times (N,), microseconds, after those whose TIME_HIGH was `high`.

    Source: Prophesee, EVT 2.0 format.
    """
    highs = t_us >> 6
    words = block.polarity.astype(np.int64) << 28 | (t_us & 0x3F) << 22
    words |= block.x.astype(np.int64) << 11 | block.y
    new = np.flatnonzero(np.diff(highs, prepend=high))
    return np.insert(words, new, TIME_HIGH | highs[new]).astype("<u4")


def _check(block: EventBlock, t_us: NDArray[np.int64]) -> None:
    largest = max(int(block.x.max()), int(block.y.max()))
    if largest > LARGEST_PIXEL:
        raise InputError(f"--to raw: EVT2 has pixels up to {LARGEST_PIXEL}, not {largest}")
    if t_us.min() < 0 or t_us.max() >= LONGEST_US:
        raise InputError("--to raw: EVT2 has 4.8 hours; convert to another format")
