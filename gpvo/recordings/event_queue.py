"""Events of one camera that wait to be taken, without being joined."""

from __future__ import annotations

from collections import deque
from itertools import takewhile

import numpy as np

from gpvo.recordings.base import Events


class EventQueue:
    """Consecutive parts of a camera's events, in order of time.

    To join parts takes longer than most of what is done with them.
    """

    def __init__(self) -> None:
        self._parts, self._count = deque[Events](), 0

    def __len__(self) -> int:
        return self._count

    @property
    def first(self) -> float:
        """Time of the first event, seconds; inf if there is none."""
        return float(self._parts[0].t[0]) if self._parts else np.inf

    @property
    def last(self) -> float:
        """Time of the last event, seconds; -inf if there is none."""
        return float(self._parts[-1].t[-1]) if self._parts else -np.inf

    def add(self, events: Events) -> None:
        """Add the next events of the stream."""
        if len(events):
            self._parts.append(events)
            self._count += len(events)

    def count_before(self, stop: float) -> int:
        """Return the number of events before a time, seconds."""
        begun = takewhile(lambda part: part.t[0] < stop, self._parts)
        return sum(int(np.searchsorted(part.t, stop)) for part in begun)

    def time_of(self, number: int) -> float:
        """Return the time of an event, counted from 0, in seconds; inf if there are not so many."""
        if number >= self._count:
            return np.inf
        for part in self._parts:
            if number < len(part):
                break
            number -= len(part)
        return float(part.t[number])

    def take(self, stop: float) -> tuple[Events, ...]:
        """Remove the events before a time, seconds, and return their parts."""
        taken = []
        while self.first < stop:
            part = self._parts.popleft()
            split = int(np.searchsorted(part.t, stop))
            taken.append(part[:split])
            self._count -= split
            if split < len(part):
                self._parts.appendleft(part[split:])
        return tuple(taken)
