"""What the columns of a text file of events hold: by names in its first lines, or by numbers."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpvo.recordings.files.text_names import REMEDY, named_columns, stated_size
from gpvo.recordings.files.text_numbers import (
    NANOSECONDS,
    USUAL_ORDER,
    Array,
    column_roles,
    found_unit,
)

SAMPLE_BYTES = 1 << 15
"""Bytes at the start, in the middle and at the end that are looked at."""
MARKS = bytes.maketrans(b",;\t|%", b"    #")
"""Makes spaces of all separators, and one mark of both marks of comments."""
TRUTHS = {b"True": b"1", b"False": b"0", b"true": b"1", b"false": b"0"}
"""Polarities of bool, as tables of other programs are written."""
UNITS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


@dataclass(frozen=True)
class TextLayout:
    """Columns of a text file.

    Attributes
    ----------
    columns
        Number of the column of t, x, y, polarity, and of nanoseconds (beside whole seconds) and
        camera where there are any.
    width
        Number of columns.
    unit
        That of t: s, ms, us or ns.
    resolution
        (width, height) that the file states, or None.
    cameras
        Indices of the cameras in the file, in order; empty without such a column.
    start
        Position of the first event in the file.
    is_named
        Whether the file names columns and unit, so that nothing was guessed.
    """

    columns: dict[str, int]
    width: int
    unit: str
    resolution: tuple[int, int] | None = None
    cameras: tuple[int, ...] = ()
    start: int = 0
    is_named: bool = False

    @property
    def unit_ns(self) -> int:
        """Nanoseconds in a unit of t."""
        return NANOSECONDS[self.unit]

    @property
    def note(self) -> str:
        """What was found without names, where it is other than usual; else empty."""
        if self.is_named or (self.columns, self.width, self.unit) == (USUAL_ORDER, 4, "s"):
            return ""
        names = {number: name for name, number in self.columns.items()}
        order = " ".join(names.get(number, "-") for number in range(self.width))
        return f"columns are taken as {order}, t in {UNITS[self.unit]}; if they are not, {REMEDY}"


def text_layout(path: Path, resolution: tuple[int, int] | None = None) -> TextLayout | None:
    """Find the layout of a text file of events; None if it is none.

    Parameters
    ----------
    resolution
        (width, height) of the sensor, if it is known; where the order of x and y is not named, it
        may tell it.

    Raises
    ------
    InputError
        If names are those of events, but one is missing or there twice.
    """
    samples = _samples(path)
    blocks = [_rows(sample) for sample in samples]
    counts = Counter(len(row) for rows in blocks for row in rows)
    width = counts.most_common(1)[0][0] if counts else 0
    tables = [np.array([row for row in rows if len(row) == width]) for rows in blocks]
    tables = [_finite(table) for table in tables if len(table)]
    if width < len(USUAL_ORDER) or not any(map(len, tables)):
        return None
    return _layout(path, samples[0], tables, resolution)


def _layout(
    path: Path, head: bytes, tables: list[Array], resolution: tuple[int, int] | None
) -> TextLayout | None:
    """Find the layout, given the first lines and rows of numbers (N, M) from several places."""
    table, width = np.concatenate(tables), tables[0].shape[1]
    lines = _first_lines(head, width)
    named = [named_columns(line.decode(errors="replace"), width, str(path)) for line in lines]
    columns, unit = next((one for one in named if one[0]), ({}, ""))
    sizes = [stated_size(line.decode(errors="replace")) for line in lines]
    size = next((one for one in sizes if one), None)
    found = columns or column_roles(table, size or resolution)
    if found is None:
        return None
    if "nanoseconds" in found:
        unit = "s"
    is_named = bool(columns and unit)
    unit = unit or found_unit([table[:, found["t"]] for table in tables])
    indices = np.unique(table[:, found["camera"]]).tolist() if "camera" in found else []
    cameras, start = tuple(map(int, indices)), sum(map(len, lines))
    return TextLayout(found, width, unit, size, cameras, start, is_named)


def _first_lines(head: bytes, width: int) -> list[bytes]:
    """Return the lines before the first one of `width` numbers."""
    lines = head.splitlines(keepends=True)
    first = (k for k, line in enumerate(lines) if [len(row) for row in _rows(line)] == [width])
    return lines[: next(first, 0)]


def _samples(path: Path) -> list[bytes]:
    """Return lines of the start, the middle and the end of a file; all of a small one."""
    size = path.stat().st_size
    places = (0, size // 2, size - SAMPLE_BYTES) if size > 3 * SAMPLE_BYTES else (0,)
    samples = []
    with path.open("rb") as file:
        for place in places:
            file.seek(place)
            lines = file.read(SAMPLE_BYTES if len(places) > 1 else size).splitlines(keepends=True)
            samples.append(b"".join(lines[1 if place else 0 : -1 if len(places) > 1 else None]))
    return samples


def number_lines(data: bytes) -> list[bytes]:
    """Return lines with numbers only, between spaces, and comments that begin with #."""
    if b"e" in data:  # which all of these have, and numbers seldom
        for word, number in TRUTHS.items():
            data = data.replace(word, number)
    return data.translate(MARKS).splitlines()


def _rows(sample: bytes) -> list[list[float]]:
    """Return the numbers of the lines that hold nothing else."""
    rows = []
    for line in number_lines(sample):
        try:
            rows.append([float(number) for number in line.partition(b"#")[0].split()])
        except ValueError:
            continue
    return [row for row in rows if row]


def _finite(table: Array) -> Array:
    return table[np.isfinite(table).all(axis=1)]
