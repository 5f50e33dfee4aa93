"""What is given up when the computer cannot keep up: short clusters, features, and then events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpvo.recordings.streams import EventBlock

BUSY = 0.65
"""Share of the time that the work on clusters may take: with more, some wait for others."""
MEMORY = 0.15
"""Time over which that share is averaged, seconds."""
LONGEST_CLUSTERS = 4.0
"""Longest clusters, times the usual length: landmarks are still followed from one to the next."""
LATE, EARLY = 0.07, 0.06
"""Latency above which fewer features are tracked, and below which more are, seconds."""
FEWER, MORE, FEWEST = 0.85, 1.04, 0.5
"""Factors of the share of features that are tracked, cluster by cluster, and its least value."""

CAUGHT_UP = 0.03
"""Age of what waits at which the computer has caught up, seconds; a cluster makes it older."""
HURRY = 0.3
"""Time without having caught up after which more is shed, seconds."""
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
    cluster_length
        Times the usual length of clusters.
    features
        Share of the features that are tracked.
    stride
        Of so many events one is used.
    """

    cluster_length: float = 1.0
    features: float = 1.0
    stride: int = 1

    def __str__(self) -> str:
        """Say what is shed, as in a sentence."""
        said = [f"clusters {self.cluster_length:.2g} times longer"] * (self.cluster_length > 1)
        said += [f"{self.features:.0%} of the features"] * (self.features < 1)
        said += [f"one of {self.stride} events"] * (self.stride > 1)
        return ", ".join(said) or "nothing is shed"

    def and_less(self, other: Level) -> Level:
        """Return the level that sheds what either one does."""
        return Level(
            max(self.cluster_length, other.cluster_length),
            min(self.features, other.features),
            max(self.stride, other.stride),
        )


BEHIND = (
    Level(),
    Level(features=FEWEST),
    Level(features=0.25, stride=2),
    Level(features=0.25, stride=4),
)
"""What is shed at least, in this order, while events wait all the same."""


class Load:
    """How much is shed, by how busy the computer is, how late estimates are, and how long events
    wait.

    Longer clusters are fewer: they cure work that takes most of the time, and cost little. Fewer
    features make each cluster's work shorter: they cure late estimates. Where events wait even so,
    features are given up at once, and then events.

    Attributes
    ----------
    thinned, discarded
        Numbers of events that were shed: some of many, and all of a time.
    worst
        The most that was shed of each kind so far.
    full_seconds, seconds
        Time in which nothing was shed, and all of it.
    """

    def __init__(self) -> None:
        self.thinned = self.discarded = 0
        self.worst = Level()
        self.seconds = self.full_seconds = 0.0
        self._needed, self._features = 1.0, 1.0
        self._behind, self._patience, self._tried = 0, PATIENCE, -np.inf
        self._now: float | None = None
        self._caught_up = self._changed = 0.0

    @property
    def level(self) -> Level:
        """What is shed now."""
        length = min(max(self._needed, 1.0), LONGEST_CLUSTERS)
        return Level(length, self._features).and_less(BEHIND[self._behind])

    @property
    def is_behind(self) -> bool:
        """Events wait."""
        return self._behind > 0

    def worked(self, seconds: float, arrived: float, latency: float) -> None:
        """Take account of a cluster: the time its work took, its events to arrive, its latency.

        All in seconds.
        """
        usual = max(arrived, 1e-3) / self.level.cluster_length
        needed = min(seconds / (BUSY * usual), 2 * LONGEST_CLUSTERS)
        self._needed += min(1.0, arrived / MEMORY) * (needed - self._needed)
        if latency > LATE:
            self._features = max(FEWER * self._features, FEWEST)
        elif latency < EARLY:
            self._features = min(MORE * self._features, 1.0)
        self.worst = self.worst.and_less(self.level)

    def waited(self, age: float, now: float) -> None:
        """Take account of the time `now` and the age of what waits longest, seconds."""
        if self._now is None:
            self._now = self._caught_up = self._changed = now
        self.seconds += now - self._now
        self.full_seconds += (now - self._now) * (self.level == Level())
        self._now = now
        if age < CAUGHT_UP:
            self._caught_up = now
        unchanged = now - self._changed
        if now - self._caught_up > HURRY:
            if unchanged > (HURRY if age < OLD else HURRY / 2):
                self._shed_more(now)
        elif unchanged > self._patience and self.is_behind:
            self._shed_less(now)

    def thin(self, block: EventBlock) -> EventBlock:
        """Return the share of a camera's events that is used, and count the others."""
        stride = self.level.stride
        if stride == 1:
            return block
        # By their numbers, so that the columns are contiguous: kernels are compiled for these.
        thinned = block[np.arange(0, len(block), stride)]
        self.thinned += len(block) - len(thinned)
        return thinned

    def _shed_more(self, now: float) -> None:
        in_vain = now - self._tried < IN_VAIN
        self._patience = min(2 * self._patience, MOST_PATIENCE) if in_vain else PATIENCE
        self._tried = -np.inf
        self._behind, self._changed = min(self._behind + 1, len(BEHIND) - 1), now
        self.worst = self.worst.and_less(self.level)

    def _shed_less(self, now: float) -> None:
        self._behind, self._changed, self._tried = self._behind - 1, now, now
