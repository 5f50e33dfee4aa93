"""Cut two streams of event blocks into batches that cover the same time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpvo.recordings.base import Events, StereoEvents
from gpvo.recordings.event_queue import EventQueue

LONGEST_SILENCE = 60.0
"""Seconds; a longer time without events, perhaps from a damaged stamp, is one batch."""
BATCH_LENGTH = 0.1
"""Duration of batches unless another is asked for, seconds."""
MOST = 1 << 19
"""Number of a camera's events in a batch, as many as in a reader's block: each batch holds up other
threads several times, which takes longer than to join parts of two blocks."""


def stereo_batches(
    left: Iterator[Events],
    right: Iterator[Events],
    start: float,
    stop: float,
    length: float = BATCH_LENGTH,
) -> Iterator[StereoEvents]:
    """Yield batches of `length` seconds that cover [start, stop), left and right in step.

    Where a camera has more than MOST events in that time, there are several.

    Parameters
    ----------
    left, right
        Blocks of any size in time order, without events before `start`. A block is taken
        only when a batch needs it.
    start, stop, length
        Seconds; the last batch may be shorter, and one without events longer.
    """
    if not length > 0.0:
        raise ValueError(f"batch length {length} s is not positive")
    cut_left, cut_right = _Cutter(left), _Cutter(right)
    first = end = start
    number = 0
    while first < stop:
        if first == end:
            silence = min(cut_left.upcoming, cut_right.upcoming, stop) - first
            number += max(1, int(silence / length)) if silence > LONGEST_SILENCE else 1
            end = min(start + number * length, stop)
        last = min(cut_left.full_at(first, end), cut_right.full_at(first, end))
        yield StereoEvents(first, last, cut_left.until(last), cut_right.until(last))
        first = last


class _Cutter:
    """Takes blocks from a stream and cuts them at chosen times."""

    def __init__(self, blocks: Iterator[Events]) -> None:
        self._blocks, self._waiting, self._at_end = blocks, EventQueue(), False

    @property
    def upcoming(self) -> float:
        """Time of the next event: -inf if none has been read yet, inf after the last one."""
        return self._waiting.first if len(self._waiting) or self._at_end else -np.inf

    def full_at(self, start: float, stop: float) -> float:
        """Return the time until which a batch from `start` has MOST events, `stop` at most."""
        while not self._at_end and len(self._waiting) <= MOST and self._waiting.last < stop:
            self._read()
        full = self._waiting.time_of(MOST)
        return full if start < full < stop else stop

    def until(self, stop: float) -> Events:
        """Return all events before `stop` that have not been returned yet."""
        while not self._at_end and self._waiting.last < stop:
            self._read()
        return Events.concatenate(self._waiting.take(stop))

    def _read(self) -> None:
        block = next(self._blocks, None)
        if block is None:
            self._at_end = True
        else:
            self._waiting.add(block)
