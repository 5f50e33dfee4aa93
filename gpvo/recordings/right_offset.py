"""A right camera whose stamps are late: its events are taken as early as they happened."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.base import Events, Recording, StereoEvents
from gpvo.recordings.checks.clock_offset import ClockOffset
from gpvo.recordings.checks.row_rates import RowRates
from gpvo.recordings.event_batches import stereo_batches

log = logging.getLogger("gpvo.recordings")

LOOKED_AT = 20.0
"""Seconds from the start of which the offset is found."""


class ShiftedRecording(Recording):
    """A recording with the right camera's stamps `late` seconds earlier; t = 0 stays."""

    def __init__(self, recording: Recording, late: float) -> None:
        self.recording, self.late = recording, late
        self.path, self.rig, self.start_ns = recording.path, recording.rig, recording.start_ns
        self.duration, self.format_name = recording.duration, recording.format_name
        self.notes, self.faults = recording.notes, recording.faults

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = self.within(start, stop)
        left = (batch.left for batch in self.recording.event_batches(start, stop))
        yield from stereo_batches(left, self._right(start, stop), start, stop)

    def _right(self, start: float, stop: float) -> Iterator[Events]:
        for batch in self.recording.event_batches(start + self.late, stop + self.late):
            earlier = replace(batch.right, t=np.round(batch.right.t - self.late, 9))
            yield earlier.between(start, np.inf)


def with_right_offset(recording: Recording, offset: str) -> Recording:
    """Return the recording with the right camera's stamps earlier; see `offset_of`."""
    late = offset_of(recording, offset)
    return recording if late == 0 else ShiftedRecording(recording, late)


def offset_of(recording: Recording, offset: str) -> float:
    """Return the seconds by which the right camera's stamps are late.

    Parameters
    ----------
    offset
        Seconds by which they are late, or auto to find it in the cameras' event rates.

    Raises
    ------
    InputError
        If it is neither, or the rates show no clear offset.
    """
    if offset != "auto":
        return offset_seconds(offset)
    found = found_offset(recording)
    if found is None:
        raise InputError(
            f"{recording.path}: --right-offset auto: the cameras' events show no clear offset of"
            " their clocks; give its seconds, or 0"
        )
    if not found.is_apart:
        return 0.0
    log.warning("the right camera's stamps are %s late, and taken earlier by that", found)
    return round(found.seconds, 6)


def found_offset(recording: Recording) -> ClockOffset | None:
    """Find how late the right camera's stamps are; None without a clear result."""
    rates = RowRates(recording.rig, LOOKED_AT)
    for batch in recording.event_batches(0.0, LOOKED_AT):
        rates.add(batch)
    return rates.offset()


def offset_seconds(offset: str) -> float:
    """Read an offset, seconds; InputError if it is none."""
    try:
        late = float(offset)
    except ValueError:
        late = np.nan
    if not np.isfinite(late):
        raise InputError(f"--right-offset {offset}: give seconds, or auto")
    return late
