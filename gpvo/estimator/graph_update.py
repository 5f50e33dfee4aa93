"""What one update adds to GTSAM's fixed-lag smoother, and takes out of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

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

    def before(self, t: float) -> int:
        """Return how many states are earlier than t."""
        return int(np.searchsorted(self.states.t, t))

    def after(self, count: int) -> NumberedStates:
        """Return the states without the first `count`."""
        return NumberedStates(self.first + count, self.states[count:])

    def until(self, count: int) -> NumberedStates:
        """Return the first `count` states."""
        return NumberedStates(self.first, self.states[:count])

    def values(self) -> gtsam.Values:
        """Return the states as GTSAM's values."""
        values = gtsam.Values()
        insert_states(values, self.numbers, self.states)
        return values


@dataclass
class GraphUpdate:
    """New factors, variables and time stamps, which decide when a key leaves; and old factors."""

    graph: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    stamps: dict[Any, float] = field(default_factory=dict)
    factors: list[gtsam.NonlinearFactor] = field(default_factory=list)
    removed: list[int] = field(default_factory=list)

    def add_factors(self, factors: Iterable[gtsam.NonlinearFactor]) -> None:
        """Add factors. Python keeps them alive, as callbacks are faster then."""
        for factor in factors:
            self.graph.push_back(factor)
            self.factors.append(factor)

    def add_states(self, new: NumberedStates) -> None:
        """Add states to the variables."""
        insert_states(self.values, new.numbers, new.states)
        for state, t in zip(new.numbers, new.states.t.tolist(), strict=True):
            self.stamps[X(state)] = self.stamps[V(state)] = t


def graph_of(factors: Iterable[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    """Return a graph of factors."""
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.push_back(factor)
    return graph


def insert_states(values: gtsam.Values, numbers: Sequence[int], states: States) -> None:
    """Insert states with these numbers (K,): X(k), a Pose3, and V(k)."""
    for k, T, twist in zip(numbers, states.T_world_cam, states.twist, strict=True):
        values.insert(X(k), gtsam.Pose3(T))
        values.insert(V(k), twist)
