"""Write text: a file for each camera, with one event a line."""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

from gpvo.recordings.base import SIDES
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.writer import RecordingWriter, Size, Sizes, microseconds


class TextWriter(RecordingWriter):
    """Writer of a folder with left.txt and right.txt: lines of `t x y polarity`, t in seconds."""

    ending = "txt"

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        path.mkdir()
        self._files: list[TextIO] = []
        for side, size in zip(SIDES, sizes, strict=False):
            self._files.append((path / f"{side}.{self.ending}").open("w", encoding="ascii"))
            self._files[-1].write(self.head(size))

    def head(self, size: Size) -> str:
        """Return the first lines."""
        return (f"# geometry:{size[0]},{size[1]}\n" if all(size) else "") + "# t[s] x y polarity\n"

    def lines(self, block: EventBlock) -> str:
        """Return the events' lines."""
        seconds = (microseconds(block.t_ns) / 1e6).tolist()
        rows = zip(
            seconds, block.x.tolist(), block.y.tolist(), block.polarity.tolist(), strict=True
        )
        return "".join(f"{t:.6f} {x} {y} {p:d}\n" for t, x, y, p in rows)

    def append(self, *blocks: EventBlock) -> None:
        for file, block in zip(self._files, blocks, strict=True):
            file.write(self.lines(block))

    def close(self) -> None:
        for file in self._files:
            file.close()


class CsvWriter(TextWriter):
    """Writer of a folder with left.csv and right.csv: t[us],x,y,polarity."""

    ending = "csv"

    def head(self, size: Size) -> str:
        """Return the first line."""
        return "t[us],x,y,polarity\n"

    def lines(self, block: EventBlock) -> str:
        """Return the events' lines."""
        t = microseconds(block.t_ns).tolist()
        rows = zip(t, block.x.tolist(), block.y.tolist(), block.polarity.tolist(), strict=True)
        return "".join(f"{t},{x},{y},{p:d}\n" for t, x, y, p in rows)
