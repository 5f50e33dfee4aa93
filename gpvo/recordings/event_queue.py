"""Events of one camera that wait to be taken, without being joined."""

from __future__ import annotations

from collections import deque

import numpy as np

from gpvo.recordings.base import Events


class EventQueue:
    """Consecutive parts of a camera's events, in order of time.

    To join parts takes longer than most of what is done with them.
    """

    def __init__(self) -> None:
        self._parts = deque[Events]()

    def __len__(self) -> int:
        return sum(map(len, self._parts))

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

    def count_before(self, stop: float) -> int:
        """Return the number of events before a time, seconds."""
        return sum(int(np.searchsorted(part.t, stop)) for part in self._parts)

    def time_of(self, number: int) -> float:
        """Return the time of an event, counted from 0, in seconds; inf if there are not so many."""
        for part in self._parts:
            if number < len(part):
                return float(part.t[number])
            number -= len(part)
        return np.inf

    def take(self, stop: float) -> tuple[Events, ...]:
        """Remove the events before a time, seconds, and return their parts."""
        taken = []
        while self.first < stop:
            part = self._parts.popleft()
            split = int(np.searchsorted(part.t, stop))
            taken.append(part[:split])
            if split < len(part):
                self._parts.appendleft(part[split:])
        return tuple(taken)
