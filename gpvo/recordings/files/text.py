"""Read text files of events: one event a line, in any order of columns; see `text_layout`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.calibration.unknown import LARGEST
from gpvo.recordings.files.text_layout import (
    SAMPLE_BYTES,
    UNITS,
    TextLayout,
    number_lines,
    text_layout,
)
from gpvo.recordings.files.text_numbers import LARGEST_PIXEL, Array
from gpvo.recordings.streams import EventBlock, EventStream, Faults, nanoseconds

BLOCK_BYTES = 1 << 23
DAMAGED_LINES = "damaged lines were skipped"


def is_text(path: Path) -> bool:
    """Return whether a file holds lines of events."""
    return path.is_file() and text_layout(path) is not None


class TextStream(EventStream):
    """Event stream of one camera in a text file.

    Parameters
    ----------
    resolution
        (width, height) of the camera, if it is known; it tells x from y where that is not said.
    camera
        Index of the camera, of several in the file; None if it is the only one.

    Raises
    ------
    InputError
        If the file holds no lines of events.
    """

    def __init__(
        self, path: Path, resolution: tuple[int, int] | None = None, camera: str | None = None
    ) -> None:
        layout = text_layout(path, None if resolution == LARGEST else resolution)
        if layout is None:
            raise InputError(f"{path}: holds no lines of t, x, y and polarity")
        self.path, self.layout, self._camera = path, layout, camera
        self.where = str(path) if camera is None else f"{path}: camera {camera}"
        self.resolution, self.time_unit = layout.resolution, UNITS[layout.unit]
        self.notes = [f"{path}: {layout.note}"] if layout.note else []

    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        with self.path.open("rb") as file:
            file.seek(self.layout.start)
            while lines := file.readlines(BLOCK_BYTES):
                yield self._block(lines, faults)

    def ends(self) -> Iterator[EventBlock]:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            file.seek(max(self.layout.start, size - SAMPLE_BYTES))
            lines = file.readlines()
        block = self._block(lines[1:] if len(lines) > 1 else lines, Faults())
        yield from [block] if len(block) else self.blocks(None, Faults())

    def _block(self, lines: list[bytes], faults: Faults) -> EventBlock:
        table = _table(lines, self.layout.width, faults)
        columns = self.layout.columns
        pixels = table[:, [columns["x"], columns["y"]]]
        fits = np.isfinite(table).all(axis=1)
        fits &= np.abs(table[:, columns["t"]]) * self.layout.unit_ns < 9e18
        fits &= (pixels >= 0).all(axis=1) & (pixels <= LARGEST_PIXEL).all(axis=1)
        faults[DAMAGED_LINES] += int((~fits).sum())
        if self._camera is not None:
            fits &= table[:, columns["camera"]] == int(self._camera)
        x, y = pixels[fits].T.astype(np.uint16)
        return EventBlock(
            x, y, _stamps(table[fits], self.layout), table[fits, columns["polarity"]] > 0
        )


def cameras_in(path: Path) -> list[str]:
    """Return the indices of the cameras in a file of several; empty for one of a single camera."""
    layout = text_layout(path)
    several = layout is not None and len(layout.cameras) > 1
    return [str(camera) for camera in layout.cameras] if layout and several else []


def _stamps(table: Array, layout: TextLayout) -> np.ndarray:
    t_ns = nanoseconds(table[:, layout.columns["t"]], layout.unit_ns)
    if "nanoseconds" in layout.columns:
        t_ns = t_ns + table[:, layout.columns["nanoseconds"]].astype(np.int64)
    return t_ns


def _table(lines: list[bytes], width: int, faults: Faults) -> Array:
    """Return the numbers (N, width) of the lines that hold so many."""
    even = number_lines(b"".join(lines))
    try:
        table = np.loadtxt(even, np.float64, comments="#", ndmin=2)
    except (ValueError, UnicodeDecodeError):
        table = np.empty((0, 0))
    return table if table.shape[1] == width else _intact(even, width, faults)


def _intact(lines: list[bytes], width: int, faults: Faults) -> Array:
    """Parse lines one by one and return those of `width` numbers, (N, width)."""
    rows = []
    for line in lines:
        content = line.split(b"#", 1)[0].split()
        if not content:
            continue
        try:
            rows.append([float(field) for field in content])
        except ValueError:
            rows.append([])
    good = [row for row in rows if len(row) == width]
    faults[DAMAGED_LINES] += len(rows) - len(good)
    return np.array(good, np.float64).reshape(-1, width)
