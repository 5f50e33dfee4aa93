"""What one update adds to GTSAM's fixed-lag smoother and takes out of it, and how landmarks do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NumberedStates:
    """The states in the window: the k-th has the keys X(first + k), a Pose3, and V(first + k)."""

    first: int
    states: States

    @property
    def numbers(self) -> range:
        """Number of each state."""
        return range(self.first, self.first + len(self.states))


@dataclass
class Increment:
    """New factors, variables and time stamps, which decide when a key leaves; and old factors."""

    graph: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    stamps: dict[Any, float] = field(default_factory=dict)
    factors: list[gtsam.NonlinearFactor] = field(default_factory=list)
    removed: list[int] = field(default_factory=list)

    def add_factors(self, factors: Iterable[gtsam.NonlinearFactor]) -> None:
        """Add factors, which Python keeps alive as callbacks are faster then."""
        for factor in factors:
            self.graph.push_back(factor)
            self.factors.append(factor)

    def add_states(self, new: NumberedStates) -> None:
        """Add states to the variables."""
        t, T_world_cam, twist = new.states.t, new.states.T_world_cam, new.states.twist
        for k, state in enumerate(new.numbers):
            self.values.insert(X(state), gtsam.Pose3(T_world_cam[k]))
            self.values.insert(V(state), twist[k])
            self.stamps[X(state)] = self.stamps[V(state)] = t[k]


class Landmarks(Protocol):
    """How landmarks enter the graph; `used` are the measurements in the window."""

    used: Measurements

    def add_to(
        self, increment: Increment, window: NumberedStates, new: Measurements, leave_before: float
    ) -> None:
        """Add what new measurements tell; states before `leave_before` leave with this update."""
        ...

    def add_all_to(self, increment: Increment, window: NumberedStates) -> None:
        """Add what all measurements in the window tell, to a smoother that is new."""
        ...

    def updated(self, estimate: gtsam.Values, states: States, added: Sequence[int]) -> None:
        """The smoother's new estimate, and the indices of the factors that were added."""
        ...
