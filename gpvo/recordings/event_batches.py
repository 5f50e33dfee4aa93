"""Cut two streams of event blocks into batches that cover the same time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpvo.recordings.base import Events, StereoEvents

LONGEST_SILENCE = 60.0
"""Seconds; a longer time without events, perhaps from a damaged stamp, is one batch."""


def stereo_batches(
    left: Iterator[Events], right: Iterator[Events], start: float, stop: float, length: float
) -> Iterator[StereoEvents]:
    """Yield batches of `length` seconds that cover [start, stop), left and right in step.

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
    first, number = start, 0
    while first < stop:
        silence = min(cut_left.upcoming, cut_right.upcoming, stop) - first
        number += max(1, int(silence / length)) if silence > LONGEST_SILENCE else 1
        last = min(start + number * length, stop)
        yield StereoEvents(first, last, cut_left.until(last), cut_right.until(last))
        first = last


class _Cutter:
    """Buffer that takes blocks from a stream and cuts them at chosen times."""

    def __init__(self, blocks: Iterator[Events]) -> None:
        self._blocks = blocks
        self._rest = Events.empty()
        self._at_end = False

    @property
    def upcoming(self) -> float:
        """Time of the next event: -inf if none has been read yet, inf after the last one."""
        if len(self._rest):
            return float(self._rest.t[0])
        return np.inf if self._at_end else -np.inf

    def until(self, stop: float) -> Events:
        """Return all events before `stop` that have not been returned yet."""
        parts = [self._rest]
        while len(parts[-1]) == 0 or parts[-1].t[-1] < stop:
            block = next(self._blocks, None)
            if block is None:
                self._at_end = True
                break
            parts.append(block)
        split = int(np.searchsorted(parts[-1].t, stop, side="left"))
        self._rest = parts[-1][split:]
        parts[-1] = parts[-1][:split]
        return parts[0] if len(parts) == 1 else Events.concatenate(parts)
