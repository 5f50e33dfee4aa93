"""Play a recording at its own pace, or at a multiple of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from gpvo.live.sources.packet import Packet
from gpvo.recordings import Recording
from gpvo.recordings.writing.writer import stamped
from gpvo.second_thread import prefetched

PACKET = 0.005
"""Seconds of events in a packet, like a camera's driver."""
START_UP = 0.2
"""Seconds before the first packet, to open the file."""


class RecordingPlayer:
    """Source that gives a recording's events `speed` times as fast as they were recorded.

    A packet arrives when its time has come, whether it could be read by then or not.
    """

    def __init__(
        self,
        recording: Recording,
        speed: float = 1.0,
        start: float = 0.0,
        duration: float = np.inf,
    ) -> None:
        self._recording, self._speed = recording, speed
        self._start, self._stop = start, start + duration
        self._is_open = True

    def packets(self) -> Iterator[Packet]:
        """Yield the events, each packet when its time has come."""
        begin = time.perf_counter() + START_UP
        for batch in prefetched(self._recording.event_batches(self._start, self._stop)):
            edges = np.append(np.arange(batch.start, batch.stop, PACKET), batch.stop)
            for start, stop in pairwise(edges.tolist()):
                arrival = begin + (stop - self._start) / self._speed
                time.sleep(max(0.0, arrival - time.perf_counter()))
                if not self._is_open:
                    return
                left, right = (
                    stamped(side.between(start, stop), self._recording.start_ns)
                    for side in (batch.left, batch.right)
                )
                yield Packet(left, right, arrival, is_played=True)

    def close(self) -> None:
        """End the play."""
        self._is_open = False
