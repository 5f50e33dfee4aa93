"""Shedding of load when the computer cannot keep up: features, then clusters, then events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpvo.recordings.streams import EventBlock

LATE = 0.06
"""Latency from which an estimate is late, seconds; fewer features are the only cure."""
CAUGHT_UP = 0.03
"""Age of what waits at which the computer has caught up, seconds; a cluster makes it older."""
HURRY = 0.3
"""Time of being late, or without having caught up, after which something is shed, seconds."""
OLD = 0.25
"""Age of what waits from which more is shed sooner, seconds."""
PATIENCE, MOST_PATIENCE = 1.0, 20.0
"""Time of keeping up after which less is shed, seconds; each time in vain doubles it."""
IN_VAIN = 1.0
"""Time until more is shed again after which it was not in vain, seconds."""
LONGEST = 0.5
"""Age at which what waits is thrown away, seconds."""


@dataclass(frozen=True)
class Level:
    """How much of the work is done.

    Attributes
    ----------
    features
        Share of the features that are tracked.
    cluster_length
        Times the usual length of clusters.
    stride
        Of so many events one is used.
    """

    features: float = 1.0
    cluster_length: float = 1.0
    stride: int = 1

    def __str__(self) -> str:
        """Say what is shed, as in a sentence."""
        said = [f"{self.features:.0%} of the features"] * (self.features < 1)
        said += [f"clusters {self.cluster_length:g} times longer"] * (self.cluster_length > 1)
        said += [f"one of {self.stride} events"] * (self.stride > 1)
        return ", ".join(said) or "nothing is shed"


LEVELS = (
    Level(),
    Level(0.7),
    Level(0.5),
    Level(0.5, 1.5),
    Level(0.5, 2.0),
    Level(0.25, 2.0, 2),
    Level(0.25, 2.0, 4),
)
"""What is shed, in this order."""


class Load:
    """How much is shed, by how long events wait and how late the estimates are.

    Attributes
    ----------
    thinned, discarded
        Numbers of events that were shed: some of many, and all of a time.
    worst
        The highest level so far.
    seconds
        Time at each level.
    """

    def __init__(self) -> None:
        self.thinned = self.discarded = self.worst = 0
        self.seconds = [0.0] * len(LEVELS)
        self._level, self._patience, self._tried = 0, PATIENCE, -np.inf
        self._now: float | None = None
        self._caught_up = self._in_time = self._changed = 0.0

    @property
    def level(self) -> Level:
        """What is shed now."""
        return LEVELS[self._level]

    @property
    def is_full(self) -> bool:
        """Nothing is shed."""
        return self._level == 0

    @property
    def _can_be_quicker(self) -> bool:
        """Whether fewer features are the next thing to shed: longer clusters are not quicker."""
        level = LEVELS[min(self._level + 1, len(LEVELS) - 1)]
        return level.cluster_length == 1.0

    def update(self, age: float, latency: float, now: float) -> None:
        """Take account of the time `now`, seconds.

        `age` is that of what waits longest, `latency` that of the newest estimate.
        """
        if self._now is None:
            self._now = self._caught_up = self._in_time = self._changed = now
        self.seconds[self._level] += now - self._now
        self._now = now
        if age < CAUGHT_UP:
            self._caught_up = now
        if latency < LATE:
            self._in_time = now
        is_behind, is_late = now - self._caught_up > HURRY, now - self._in_time > HURRY
        has_time = not is_late or self.level.cluster_length > 1
        unchanged = now - self._changed
        if is_behind or (is_late and self._can_be_quicker):
            if unchanged > (HURRY if age < OLD else HURRY / 2):
                self._shed_more(now)
        elif unchanged > self._patience and has_time and not self.is_full:
            self._shed_less(now)

    def thin(self, block: EventBlock) -> EventBlock:
        """Return the share of a camera's events that is used, and count the others."""
        if self.level.stride == 1:
            return block
        # By their numbers, so that the columns are contiguous: kernels are compiled for these.
        thinned = block[np.arange(0, len(block), self.level.stride)]
        self.thinned += len(block) - len(thinned)
        return thinned

    def _shed_more(self, now: float) -> None:
        in_vain = now - self._tried < IN_VAIN
        self._patience = min(2 * self._patience, MOST_PATIENCE) if in_vain else PATIENCE
        self._tried = -np.inf
        self._level, self._changed = min(self._level + 1, len(LEVELS) - 1), now
        self.worst = max(self.worst, self._level)

    def _shed_less(self, now: float) -> None:
        self._level, self._changed, self._tried = self._level - 1, now, now
