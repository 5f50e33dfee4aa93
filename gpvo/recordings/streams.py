"""Event stream of one camera as in its file: unchecked blocks with absolute stamps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable

Faults = Counter[str]
"""Kinds of faults in a stream with their numbers, for example {"events ...": 12}."""

DAMAGED = "damaged parts of the file were skipped"


@dataclass(frozen=True)
class EventBlock(ArrayTable):
    """Consecutive events of one camera as in the file, unchecked.

    Attributes
    ----------
    x, y
        (N,) uint16, column and row.
    t_ns
        (N,) int64, absolute stamps in nanoseconds.
    polarity
        (N,) bool, True where the pixel became brighter.
    """

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_ns: NDArray[np.int64]
    polarity: NDArray[np.bool_]

    @staticmethod
    def empty() -> EventBlock:
        """Return a block without events."""
        return EventBlock(*(np.empty(0, kind) for kind in ("u2", "u2", "i8", "?")))

    @classmethod
    def concatenate(cls, parts: Iterable[EventBlock]) -> EventBlock:
        """Join consecutive parts of one stream; at least one is needed."""
        blocks = list(parts)
        return blocks[0] if len(blocks) == 1 else super().concatenate(blocks)


class EventStream(ABC):
    """The events of one camera on disk.

    Attributes
    ----------
    where
        File and topic, group or stream; the start of messages.
    resolution
        (width, height) that the file states, or None.
    wrap_ns
        Period after which the sensor's clock starts again; 0 for absolute stamps.
    notes
        What could not be read when the stream was opened.
    time_unit
        Unit in which the file's times are read: seconds, milliseconds, microseconds, nanoseconds.
    """

    where: str
    resolution: tuple[int, int] | None = None
    wrap_ns: int = 0
    notes: Sequence[str] = ()
    time_unit: str = "seconds"

    @abstractmethod
    def blocks(self, start_ns: int | None, faults: Faults) -> Iterator[EventBlock]:
        """Yield the events in the order of the file, in blocks of bounded size.

        Blocks wholly before start_ns may be left out. Damage that is skipped is counted in
        `faults`.
        """

    def arrival_offset_ns(self) -> int | None:
        """Return arrival time at the computer minus sensor time, or None if either is unknown."""
        return None

    def ends(self) -> Iterator[EventBlock]:
        """Yield some of the last blocks, or all blocks if the format allows no shortcut."""
        yield from self.blocks(None, Faults())


Part = TypeVar("Part", bound=Sized)


def groups(parts: Iterable[Part], size: int) -> Iterator[list[Part]]:
    """Yield consecutive parts together, as many as have `size` items; the last may have fewer."""
    group: list[Part] = []
    waiting = 0
    for part in parts:
        group.append(part)
        waiting += len(part)
        if waiting >= size:
            yield group
            group, waiting = [], 0
    if waiting:
        yield group


def unread_note(path: Path, share: float) -> str:
    """Return the note on a file of which a share, 0 to 1, cannot be read."""
    return (
        f"{path}: the file is cut short or damaged, {share:.1%} of the file cannot be read; copy"
        " it again, or go on with what is intact"
    )


def nanoseconds(times: NDArray[np.float64], unit_ns: int = 10**9) -> NDArray[np.int64]:
    """Return stamps (N,) int64 of times in units of so many nanoseconds.

    Times since 1970 are rounded to microseconds, as float64 is not exact below that.
    """
    if len(times) and np.abs(times).max() * unit_ns > 1e16:
        return np.rint(times * (unit_ns / 1000)).astype(np.int64) * 1000
    return np.rint(times * unit_ns).astype(np.int64)
