"""Interface of recordings: a stereo rig and two event streams, read in common batches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.reading_faults import ReadingFaults

SIDES = ("left", "right")


@dataclass(frozen=True)
class Events(ArrayTable):
    """Events of one camera in time order.

    Attributes
    ----------
    x, y
        (N,) uint16, column and row of the raw (distorted) pixel, origin top left.
    t
        (N,) float64, seconds since the recording's start, not decreasing.
    polarity
        (N,) bool, True where the pixel became brighter.
    """

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t: NDArray[np.float64]
    polarity: NDArray[np.bool_]

    def between(self, start: float, stop: float) -> Events:
        """Return the events with start <= t < stop, in seconds."""
        first, last = np.searchsorted(self.t, [start, stop], side="left")
        return self[first:last]

    @staticmethod
    def empty(count: int = 0) -> Events:
        """Return a table of so many events that are still to be set."""
        x, y = np.empty((2, count), np.uint16)
        return Events(x, y, np.empty(count), np.empty(count, bool))

    @classmethod
    def concatenate(cls, parts: Iterable[Events]) -> Events:
        """Join consecutive parts of one stream."""
        tables = [part for part in parts if len(part)] or [Events.empty()]
        return tables[0] if len(tables) == 1 else super().concatenate(tables)


@dataclass(frozen=True)
class StereoEvents:
    """Left and right events of the same time interval [start, stop), in seconds."""

    start: float
    stop: float
    left: Events
    right: Events


class Recording(ABC):
    """A stereo event recording on disk or in memory.

    Attributes
    ----------
    path
        File or folder that it was read from.
    rig
        The calibrated stereo rig.
    start_ns
        Absolute stamp of t = 0 (the first event of either camera), int64 nanoseconds.
    duration
        Seconds from the first event of either camera to the last.
    format_name
        Name of the format, for reports.
    notes
        What a user should know before trusting the recording, found when it was opened.
    sides
        Cameras in it: left and right, or the only one.
    time_unit
        Unit in which the file's times are read: seconds, milliseconds, microseconds, nanoseconds.
    faults
        Kinds of faults in the batches read last, and their numbers.
    """

    format_name: str = "recording"
    notes: Sequence[str] = ()
    sides: tuple[str, ...] = SIDES
    time_unit: str = "seconds"
    faults: ReadingFaults = ReadingFaults({})
    path: Path
    rig: StereoRig
    start_ns: int
    duration: float

    @abstractmethod
    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        """Yield consecutive batches that together cover [start, stop) seconds.

        Memory stays bounded: a batch is a fraction of a second. Left and right of a batch cover
        the same interval, and batches without events are yielded too, so that gaps are seen.
        """

    def within(self, start: float, stop: float) -> tuple[float, float]:
        """Return the part of [start, stop) seconds that it lasts; its last event is in it."""
        return max(start, 0.0), min(stop, float(np.nextafter(self.duration, np.inf)))

    def fault_lines(self) -> list[str]:
        """Return one line for each kind of fault in the batches read last."""
        return self.faults.lines()

    def stamp_ns(self, t: float) -> int:
        """Return the absolute stamp in nanoseconds of a time in seconds since the start."""
        return self.start_ns + round(t * 1e9)
