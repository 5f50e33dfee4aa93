"""Recordings of one or two event streams: common clock, checks, and common batches."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.errors import InputError
from gpvo.recordings.base import SIDES, Events, Recording, StereoEvents
from gpvo.recordings.calibration.rig import Camera, StereoRig
from gpvo.recordings.checks.clocks import common_clock
from gpvo.recordings.checks.sensor_size import check_resolution
from gpvo.recordings.checks.time_order import in_order
from gpvo.recordings.event_batches import BATCH_LENGTH, stereo_batches
from gpvo.recordings.reading_faults import ReadingFaults
from gpvo.recordings.streams import EventBlock, EventStream, Faults

log = logging.getLogger("gpvo.recordings")

LONGEST_NS = 10**15
"""Eleven days; no recording lasts longer."""

ONE_SIDED_NS = 500_000_000
"""Larger differences between the cameras' starts or ends are reported to the user."""

MOST_OUTSIDE = 0.25
"""If a larger part of a block is outside the sensor, the calibration is of another sensor."""

OUTSIDE = "events outside the sensor were left out"


class StreamRecording(Recording):
    """Recording of two event streams with a common clock, or of one alone.

    Parameters
    ----------
    path
        Path that the user gave.
    format_name
        Name of the format, for reports.
    rig
        The calibrated rig.
    streams
        Those of the left and the right camera, or of the only one.
    sides
        Cameras that the streams are of.
    batch_length
        Seconds.

    Attributes
    ----------
    notes
        What a user should know before trusting the recording, found when it was opened.

    Raises
    ------
    InputError
        If a stream has no events, its sensor is not the calibrated one, or the cameras have no
        time in common.
    """

    def __init__(
        self,
        path: Path,
        format_name: str,
        rig: StereoRig,
        *streams: EventStream,
        sides: Sequence[str] = SIDES,
        batch_length: float = BATCH_LENGTH,
    ) -> None:
        self.path, self.format_name, self.rig = path, format_name, rig
        self.streams = dict(zip(sides, streams, strict=False))
        self.sides, self.time_unit = tuple(self.streams), streams[0].time_unit
        self.batch_length = batch_length
        self.faults = ReadingFaults({side: one.where for side, one in self.streams.items()})
        for side, stream in self.streams.items():
            check_resolution(
                stream.resolution, self.rig.camera(side).resolution, f"{stream.where}:"
            )
        unreadable = dict.fromkeys(note for stream in streams for note in stream.notes)
        spans, clock_notes = self._aligned(streams)
        self.notes = [*unreadable, *clock_notes]
        self.start_ns = min(first for first, _ in spans)
        self.duration = (max(last for _, last in spans) - self.start_ns) / 1e9
        for note in self.notes:
            log.warning("%s", note if note.startswith(str(path)) else f"{path}: {note}")

    def _aligned(self, streams: Sequence[EventStream]) -> tuple[list[tuple[int, int]], list[str]]:
        """Align the clocks; return the first and last stamp of each camera, and notes."""
        self._shifts_ns = dict.fromkeys(SIDES, 0)
        spans = [span_ns(stream) for stream in streams]
        if len(streams) == 1:
            return spans, []
        shifts, notes = common_clock(streams[0], streams[1], spans[0][0], spans[1][0])
        self._shifts_ns = dict(zip(SIDES, shifts, strict=True))
        moved = [_shifted(span, shift) for span, shift in zip(spans, shifts, strict=True)]
        return moved, [*notes, *check_spans(self.path, *moved)]

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = self.within(start, stop)
        self.faults.clear()
        left, right = self._events("left", start), self._events("right", start)
        for batch in stereo_batches(left, right, start, stop, self.batch_length):
            self.faults.say_new(batch.stop)
            yield batch

    def _events(self, side: str, start: float) -> Iterator[Events]:
        """Yield one camera's checked events from `start` on, in seconds since the start."""
        if side not in self.streams:
            return
        camera = self.rig.camera(side)
        stream, faults = self.streams[side], self.faults[side]
        origin_ns = self.start_ns - self._shifts_ns[side]
        start_ns = origin_ns + int(np.ceil(start * 1e9))
        for block in in_order(stream.blocks(start_ns, faults), faults):
            if block.t_ns[-1] < start_ns:
                continue
            first = int(np.searchsorted(block.t_ns, start_ns, side="left"))
            inside = inside_sensor(block[first:], camera, stream.where, faults)
            t = seconds_since(origin_ns, inside.t_ns)
            yield Events(inside.x, inside.y, t, inside.polarity)


@kernel
def seconds_since(origin_ns: int, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the times (N,) of stamps (N,) since an origin, seconds: (t_ns - origin_ns) / 1e9."""
    t = np.empty(len(t_ns))
    for i in range(len(t_ns)):
        t[i] = (t_ns[i] - origin_ns) / 1e9
    return t


def span_ns(stream: EventStream) -> tuple[int, int]:
    """Return the earliest and latest credible stamp of a stream's first and last blocks."""
    ordered = in_order(stream.blocks(None, Faults()), Faults())
    first = next(ordered, None)
    if first is None:
        raise InputError(f"{stream.where}: holds no events; both cameras are needed")
    last_ns = int(first.t_ns[-1])
    for block in in_order(stream.ends(), Faults()):
        last_ns = max(last_ns, int(block.t_ns[-1]))
    return int(first.t_ns[0]), last_ns


def _shifted(span: tuple[int, int], shift_ns: int) -> tuple[int, int]:
    return span[0] + shift_ns, span[1] + shift_ns


def inside_sensor(block: EventBlock, camera: Camera, where: str, faults: Faults) -> EventBlock:
    """Return the events on the sensor.

    Raises
    ------
    InputError
        If many events lie outside, as the calibration is wrong then.
    """
    width, height = camera.resolution
    if len(block) == 0 or (block.x.max() < width and block.y.max() < height):
        return block
    inside = (block.x < width) & (block.y < height)
    outside = len(block) - int(inside.sum())
    if outside > max(MOST_OUTSIDE * len(block), 16):
        raise InputError(
            f"{where}: {outside} of {len(block)} events lie outside the {width} x {height} sensor"
            " of the calibration; give this camera's calibration"
        )
    faults[OUTSIDE] += outside
    return block[inside]


def check_spans(path: Path, left: tuple[int, int], right: tuple[int, int]) -> list[str]:
    """Return notes on the cameras' starts and ends; raise InputError if they share no time."""
    starts = (right[0] - left[0]) / 1e9
    if max(left[1], right[1]) - min(left[0], right[0]) > LONGEST_NS or (
        left[1] < right[0] or right[1] < left[0]
    ):
        raise InputError(
            f"{path}: the cameras have no time in common, the right one's clock begins"
            f" {starts:+.6f} s after the left one's (left from {left[0] / 1e9:.6f} to"
            f" {left[1] / 1e9:.6f} s, right from {right[0] / 1e9:.6f} to {right[1] / 1e9:.6f} s);"
            " record both with one clock"
        )
    notes = []
    if abs(right[0] - left[0]) > ONE_SIDED_NS:
        late = "right" if starts > 0 else "left"
        notes.append(f"the {late} camera starts {abs(starts):.3f} s after the other")
    ends = (right[1] - left[1]) / 1e9
    if abs(right[1] - left[1]) > ONE_SIDED_NS:
        early = "left" if ends > 0 else "right"
        notes.append(f"the {early} camera stops {abs(ends):.3f} s before the other")
    return notes
