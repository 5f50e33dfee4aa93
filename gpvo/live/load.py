"""What is given up when the computer cannot keep up: time between clusters, and features."""

from __future__ import annotations

from dataclasses import dataclass

from gpvo.events.clustering import WIDEST

BUSY = 0.65
"""Share of the time that the work on clusters may take: with more, some wait for others."""
MEMORY = 0.15
"""Time over which that share is averaged, seconds."""
LATE, EARLY = 0.07, 0.06
"""Latency above which fewer features are tracked, and below which more are, seconds."""
FEWER, MORE, FEWEST = 0.85, 1.04, 0.5
"""Factors of the share of features that are tracked, cluster by cluster, and its least value."""

OLD, CAUGHT_UP = 0.15, 0.03
"""Age of what waits from which all is shed, and below which it is not any more, seconds."""
LONGEST = 0.5
"""Age at which what waits is thrown away, seconds."""


@dataclass(frozen=True)
class Level:
    """How much of the work is done.

    Attributes
    ----------
    spacing
        Clusters are so many times farther apart than usual; the events between are left out.
    features
        Share of the features that are tracked.
    """

    spacing: float = 1.0
    features: float = 1.0

    def __str__(self) -> str:
        """Say what is used, as in a sentence."""
        said = [f"{1 / self.spacing:.0%} of the events"] * (self.spacing > 1)
        said += [f"{self.features:.0%} of the features"] * (self.features < 1)
        return ", ".join(said) or "nothing is shed"

    def and_less(self, other: Level) -> Level:
        """Return the level that sheds what either one does."""
        return Level(max(self.spacing, other.spacing), min(self.features, other.features))


LEAST = Level(WIDEST, FEWEST)
"""What is done while events wait: the motion can still be followed with it."""


class Load:
    """How much is shed, by how busy the computer is, how late estimates are, and how long events
    wait.

    Time between clusters cures work that takes most of the time, and costs little. Fewer features
    make each cluster's work shorter: they cure late estimates. Where events wait even so, as much
    is shed as the motion can still be followed with, until the computer has caught up.

    Attributes
    ----------
    left_out, discarded
        Numbers of events that were shed: between clusters, and all of a time.
    worst
        The most that was shed of each kind so far.
    full_seconds, seconds
        Time in which nothing was shed, and all of it.
    is_behind
        Events wait.
    """

    def __init__(self) -> None:
        self.left_out = self.discarded = 0
        self.worst = Level()
        self.seconds = self.full_seconds = 0.0
        self.is_behind = False
        self._needed, self._features = 1.0, 1.0
        self._now: float | None = None

    @property
    def level(self) -> Level:
        """What is done now."""
        if self.is_behind:
            return LEAST
        return Level(min(max(self._needed, 1.0), WIDEST), self._features)

    def worked(self, seconds: float, arrived: float, latency: float) -> None:
        """Take account of a cluster: the time its work took, its events to arrive, its latency.

        All in seconds; what was left out before it arrived, too.
        """
        usual = max(arrived, 1e-3) / self.level.spacing
        needed = min(seconds / (BUSY * usual), 2 * WIDEST)
        self._needed += min(1.0, arrived / MEMORY) * (needed - self._needed)
        if latency > LATE:
            self._features = max(FEWER * self._features, FEWEST)
        elif latency < EARLY:
            self._features = min(MORE * self._features, 1.0)
        self.worst = self.worst.and_less(self.level)

    def waited(self, age: float, now: float) -> None:
        """Take account of the time `now` and the age of what waits longest, seconds."""
        passed = 0.0 if self._now is None else now - self._now
        self.seconds += passed
        self.full_seconds += passed * (self.level == Level())
        self._now = now
        self.is_behind = age > (CAUGHT_UP if self.is_behind else OLD)
        self.worst = self.worst.and_less(self.level)
