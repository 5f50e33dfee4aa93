"""What sources give: the newest events of both cameras, with the time at which they arrived."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from gpvo.recordings.streams import EventBlock


@dataclass(frozen=True, eq=False)
class Packet:
    """Events that arrived together, unchecked.

    Attributes
    ----------
    left, right
        Events of each camera, any number.
    arrival
        Time of arrival by `time.perf_counter`, seconds.
    after_gap
        The source was silent before, and what happened meanwhile is lost.
    is_played
        Of a recording: the time of arrival says nothing of the cameras' clocks.
    """

    left: EventBlock
    right: EventBlock
    arrival: float
    after_gap: bool = False
    is_played: bool = False

    def __len__(self) -> int:
        return len(self.left) + len(self.right)


class Source(Protocol):
    """Where events come from."""

    def packets(self) -> Iterator[Packet]:
        """Yield the events as they arrive, until the source ends; empty packets show it lives."""
        ...

    def close(self) -> None:
        """Let cameras and connections go."""
        ...
