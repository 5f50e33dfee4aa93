"""What is wrong with the events of a file: said once when it is met, and counted."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from gpvo.recordings.streams import Faults

log = logging.getLogger("gpvo.recordings")


class ReadingFaults:
    """Kinds of faults in the events that were read last, and their numbers, for each camera.

    Parameters
    ----------
    where
        File and stream of each camera; the start of messages.
    """

    def __init__(self, where: Mapping[str, str]) -> None:
        self._where, self._said = where, set[tuple[str, str]]()
        self.clear()

    def clear(self) -> None:
        """Begin to count again; what was said is not said again."""
        self._of = {side: Faults() for side in self._where}

    def __getitem__(self, side: str) -> Faults:
        return self._of[side]

    def say_new(self, t: float) -> None:
        """Warn of each kind that was met for the first time, until t, seconds."""
        for side, faults in self._of.items():
            for kind in sorted(+faults):
                if (side, kind) not in self._said:
                    self._said.add((side, kind))
                    log.warning(
                        "%s: %s, the first before %.2f s; `gpvo info` counts them",
                        *(self._where[side], kind, t),
                    )

    def lines(self) -> list[str]:
        """Return one line for each kind of fault, with its number."""
        return [
            f"{self._where[side]}: {count} {kind}"
            for side, faults in self._of.items()
            for kind, count in sorted((+faults).items())
        ]

    def to_dict(self) -> dict[str, dict[str, int]]:
        """Return the numbers by camera and kind."""
        return {side: dict(+faults) for side, faults in self._of.items() if +faults}
