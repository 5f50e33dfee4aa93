"""Read text files of the RPG event camera datasets: lines of `t x y polarity`, t in seconds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gpvo.recordings.streams import EventBlock, EventStream, Faults, nanoseconds

BLOCK_BYTES = 1 << 23
DAMAGED_LINES = "damaged lines were skipped"


def is_text(path: Path) -> bool:
    """Return whether a file's first line, except comments, holds four numbers."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(4096)
    lines = [line for line in head.split(b"\n")[:20] if line.strip() and not line.startswith(b"#")]
    try:
        return bool(lines) and len([float(field) for field in lines[0].split()]) == 4
    except ValueError:
        return False


class TextStream(EventStream):
    """Event stream of a text file."""

    def __init__(self, path: Path) -> None:
        self.path, self.where = path, str(path)

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        with self.path.open("rb") as file:
            while lines := file.readlines(BLOCK_BYTES):
                yield _block(lines, self.where, faults)

    def ends(self) -> Iterator[EventBlock]:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            file.seek(max(0, size - (1 << 16)))
            lines = file.readlines()
        yield _block(lines[1:] if len(lines) > 1 else lines, self.where, Faults())


def _block(lines: list[bytes], where: str, faults: Faults) -> EventBlock:
    try:
        table = np.loadtxt(lines, np.float64, comments="#", ndmin=2)
    except (ValueError, UnicodeDecodeError):
        table = np.empty((0, 0))
    if table.shape[1] != 4:
        table = _intact(lines, faults)
    pixels = table[:, 1:3]
    fits = np.isfinite(table).all(axis=1) & (np.abs(table[:, 0]) < 9e9)
    fits &= (pixels >= 0).all(axis=1) & (pixels <= 65535).all(axis=1)
    faults[DAMAGED_LINES] += int((~fits).sum())
    table = table[fits]
    x, y = table[:, 1:3].T.astype(np.uint16)
    return EventBlock(x, y, nanoseconds(table[:, 0]), table[:, 3] > 0)


def _intact(lines: list[bytes], faults: Faults) -> np.ndarray:
    """Parse lines one by one and return those of four numbers, (N, 4)."""
    rows = []
    for line in lines:
        content = line.split(b"#", 1)[0].split()
        if not content:
            continue
        try:
            rows.append([float(field) for field in content])
        except ValueError:
            rows.append([])
    good = [row for row in rows if len(row) == 4]
    faults[DAMAGED_LINES] += len(rows) - len(good)
    return np.array(good, np.float64).reshape(-1, 4)
