"""Shedding of load when the computer cannot keep up: features first, then events."""

from __future__ import annotations

from dataclasses import dataclass

from gpvo.recordings.streams import EventBlock

CAUGHT_UP = 0.03
"""Age of what waits at which the computer has caught up, seconds; a cluster makes it older."""
HURRY = 0.3
"""Time without having caught up after which something is shed, seconds."""
AGAIN = 0.15
"""Time after which more is shed if that does not suffice, seconds."""
PATIENCE = 0.5
"""Time after which less is shed if it catches up, seconds."""
LONGEST = 0.5
"""Age at which what waits is thrown away, seconds."""


@dataclass(frozen=True)
class Level:
    """Share of the features that are tracked, and of the events that are used: one of `stride`."""

    features: float
    stride: int


LEVELS = (Level(1.0, 1), Level(0.5, 1), Level(0.25, 1), Level(0.25, 2), Level(0.25, 4))
"""What is shed, in this order."""


class Load:
    """How much is shed, by how long events wait until they are taken.

    Attributes
    ----------
    thinned, discarded
        Numbers of events that were shed: some of many, and all of a time.
    worst
        The highest level so far.
    """

    def __init__(self) -> None:
        self.thinned = self.discarded = self.worst = 0
        self._level = 0
        self._changed = self._caught_up = 0.0

    @property
    def level(self) -> Level:
        """What is shed now."""
        return LEVELS[self._level]

    @property
    def is_full(self) -> bool:
        """Nothing is shed."""
        return self._level == 0

    def update(self, age: float, now: float) -> None:
        """Take account of the age of what waits longest, seconds, at the time `now`."""
        if age < CAUGHT_UP:
            self._caught_up = now
        is_behind, unchanged = now - self._caught_up > HURRY, now - self._changed
        if is_behind and unchanged > AGAIN:
            self._change(1, now)
        elif not is_behind and unchanged > PATIENCE:
            self._change(-1, now)

    def thin(self, block: EventBlock) -> EventBlock:
        """Return the share of a camera's events that is used, and count the others."""
        thinned = block[:: self.level.stride]
        self.thinned += len(block) - len(thinned)
        return thinned

    def _change(self, step: int, now: float) -> None:
        self._level = min(max(self._level + step, 0), len(LEVELS) - 1)
        self._changed, self.worst = now, max(self.worst, self._level)
