"""Factors of users' own in the smoother's graph."""

from __future__ import annotations

import gtsam
import numpy as np

from gpvo.estimator.diagnostics import Diagnostic
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.isam2 import FAILURES


class OwnFactors:
    """Factors that a user added: waiting for the next update, or in the window.

    Attributes
    ----------
    new, active
        Those that wait, and those of which all states are in the window.
    """

    def __init__(self) -> None:
        self.new: list[gtsam.NonlinearFactor] = []
        self.active: list[gtsam.NonlinearFactor] = []

    def add_to(self, update: GraphUpdate, window: NumberedStates) -> list[Diagnostic]:
        """Add the waiting factors to an update; return a diagnostic for each one that fails."""
        diagnostics, t = [], float(window.states.t[-1])
        values = window.values()
        for factor in self.new:
            fault = fault_of(factor, values)
            if fault is None:
                self.active.append(factor)
                update.add_factors([factor])
            else:
                diagnostics.append(Diagnostic(fault[0], t, None, fault[1]))
        self.new = []
        return diagnostics

    def drop_failing(self, window: NumberedStates) -> list[Diagnostic]:
        """Drop the active factors that fail by themselves; return a diagnostic for each."""
        values, t = window.values(), float(window.states.t[-1])
        faults = [(factor, fault_of(factor, values)) for factor in self.active]
        self.active = [factor for factor, fault in faults if fault is None]
        return [Diagnostic(fault[0], t, None, fault[1]) for _, fault in faults if fault]

    def keep(self, inside: set[int]) -> None:
        """Keep the active factors of which all keys are inside the window."""
        self.active = [factor for factor in self.active if inside.issuperset(factor.keys())]


def factors_that_leave(
    in_graph: gtsam.NonlinearFactorGraph,
    update: GraphUpdate,
    window: NumberedStates,
    leaving: int,
    except_for: int | None,
) -> gtsam.NonlinearFactorGraph:
    """Return the factors between the first states, that leave, and the next one.

    Those in GTSAM's graph, except the one with the index `except_for`, and those of the update.
    One that also touches a later state is left out: landmarks then know a little less.
    """
    found = gtsam.NonlinearFactorGraph()
    if leaving == 0:
        return found
    outside = set(window.until(leaving).values().keys())
    inside = outside | set(window.until(leaving + 1).values().keys())
    numbered = ((i, in_graph.at(i)) for i in range(in_graph.size()))
    known = [factor for i, factor in numbered if factor is not None and i != except_for]
    for factor in (*known, *update.factors):
        keys = set(factor.keys())
        if keys & outside and keys <= inside:
            found.push_back(factor)
    return found


def fault_of(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> tuple[str, str] | None:
    """Return the key and the reason why a factor cannot be used with these values, or None."""
    keys = list(factor.keys())
    missing = [key for key in keys if not values.exists(key)]
    if missing:
        name = gtsam.DefaultKeyFormatter(missing[0])
        return name, "factor of your own left out: its state is not in the window"
    name = gtsam.DefaultKeyFormatter(keys[0]) if keys else "no key"
    try:
        finite = np.isfinite(factor.linearize(values).augmentedJacobian()).all()
    except (*FAILURES, TypeError) as error:
        return name, f"factor of your own left out: {error}"
    return None if finite else (name, "factor of your own left out: its error is not finite")
