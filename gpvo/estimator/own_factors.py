"""Factors of users' own in the smoother's graph."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X

from factors import InterpolatedFactor
from factors.checks import checked_key, checked_number, key_name
from factors.inner_factor import InnerFactor
from gpvo.estimator.diagnostics import Diagnostic
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.isam2 import FAILURES

LEFT_OUT = "factor of your own left out"


@dataclass(frozen=True, eq=False)
class Waiting:
    """A factor that waits for the next update, or for states around its own time t, seconds."""

    factor: InnerFactor
    t: float | None
    velocity: int | None

    def __post_init__(self) -> None:
        if self.t is not None:
            checked_number("t", self.t)
        if self.velocity is not None:
            checked_key("velocity", self.velocity)

    @property
    def name(self) -> str:
        """The time, or GTSAM's name of the first key."""
        if self.t is not None:
            return f"t = {self.t:.6f} s"
        keys = list(getattr(self.factor, "keys", list)())
        return key_name(keys[0]) if keys else "no key"

    def between(self, window: NumberedStates) -> gtsam.NonlinearFactor:
        """Return the factor, at its own time between the key states around it.

        Raises
        ------
        ValueError
            If the time lies before the window, or it is no factor of a pose.
        """
        if self.t is None:
            if not isinstance(self.factor, gtsam.NonlinearFactor):
                raise ValueError(f"{type(self.factor).__name__} is no factor")
            return self.factor
        times, numbers = window.states.t, window.numbers
        if len(times) < 2 or self.t < times[0]:
            raise ValueError(f"its time lies before the window, {times[0]:.6f} s")
        i = min(int(np.searchsorted(times, self.t, "right")), len(times) - 1) - 1
        before, after = ((X(numbers[k]), V(numbers[k]), float(times[k])) for k in (i, i + 1))
        return InterpolatedFactor(self.factor, before, after, self.t, velocity=self.velocity)


class OwnFactors:
    """Factors that a user added: waiting for the next update, or in the window.

    Attributes
    ----------
    new, active
        Those that wait, some for their own time, and those of which all states are in the window.
    used
        Whether there were any.
    """

    def __init__(self) -> None:
        self.new: list[Waiting] = []
        self.active: list[gtsam.NonlinearFactor] = []
        self.used = False

    @property
    def failures(self) -> tuple[type[Exception], ...]:
        """What may be raised where factors are used: those of a user's own raise what they like."""
        return (Exception,) if self.active else FAILURES

    def add_to(self, update: GraphUpdate, window: NumberedStates) -> list[Diagnostic]:
        """Add the waiting factors to an update; return a diagnostic for each one that fails."""
        if not self.new:
            return []
        values, t = window.values(), float(window.states.t[-1])
        ahead = [waiting for waiting in self.new if waiting.t is not None and waiting.t > t]
        ready = [waiting for waiting in self.new if waiting not in ahead]
        faults = [self._add(waiting, update, window, values) for waiting in ready]
        self.new = ahead
        return [Diagnostic(fault[0], t, None, fault[1]) for fault in faults if fault]

    def _add(
        self, waiting: Waiting, update: GraphUpdate, window: NumberedStates, values: gtsam.Values
    ) -> tuple[str, str] | None:
        """Add a waiting factor to an update; return its name and the reason if it fails."""
        try:
            factor = waiting.between(window)
        except ValueError as error:
            return waiting.name, f"{LEFT_OUT}: {error}"
        fault = fault_of(factor, values)
        if fault is None:
            self.used = True
            self.active.append(factor)
            update.add_factors([factor])
        return fault

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
    factors: Iterable[gtsam.NonlinearFactor], window: NumberedStates, leaving: int
) -> list[gtsam.NonlinearFactor]:
    """Return the factors between the first states, that leave, and the next one.

    One that also touches a later state is left out: landmarks then know a little less.
    """
    outside = {key(k) for k in window.numbers[:leaving] for key in (X, V)}
    inside = outside | {key(k) for k in window.numbers[leaving : leaving + 1] for key in (X, V)}
    keys = ((factor, set(factor.keys())) for factor in factors)
    return [factor for factor, keys in keys if keys & outside and keys <= inside]


def fault_of(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> tuple[str, str] | None:
    """Return the key and the reason why a factor cannot be used with these values, or None."""
    keys = list(factor.keys())
    missing = [key for key in keys if not values.exists(key)]
    if missing:
        name = key_name(missing[0])
        return name, f"{LEFT_OUT}: its state is not in the window"
    name = key_name(keys[0]) if keys else "no key"
    try:
        finite = np.isfinite(factor.linearize(values).augmentedJacobian()).all()
    except Exception as error:  # a factor written in Python raises what it likes
        return name, f"{LEFT_OUT}: {error}"
    return None if finite else (name, f"{LEFT_OUT}: its error is not finite")
