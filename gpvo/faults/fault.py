"""One fault, as it is told to the user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Fault:
    """Something that is wrong with the events.

    Attributes
    ----------
    kind
        A word or two; each kind is said once.
    t
        Since when, seconds since the recording's start.
    text
        What was seen, and what to do.
    harms
        Whether the estimate is worse for it.
    numbers
        What was measured, by name with unit.
    fails
        Whether the estimate is wrong by more than its covariance says.
    """

    kind: str
    t: float
    text: str
    harms: bool = True
    numbers: Mapping[str, float] = field(default_factory=dict)
    fails: bool = False

    @property
    def line(self) -> str:
        """The line that is printed."""
        return f"at {self.t:.2f} s: {self.text}"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return asdict(self)
