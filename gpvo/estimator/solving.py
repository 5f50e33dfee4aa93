"""Solving the window, also where GTSAM's smoother fails: again, with less and less in it."""

from __future__ import annotations

from collections.abc import Callable

from gtsam.symbol_shorthand import X

from factors.checks import key_name
from gpvo.estimator.diagnostics import Diagnostic
from gpvo.estimator.graph_update import GraphUpdate
from gpvo.estimator.lag_window import LagWindow
from gpvo.estimator.own_factors import LEFT_OUT as OWN_LEFT_OUT
from gpvo.tracking.measurements import Measurements

SOLVED_AGAIN = "indeterminate: the window was solved again"
LEFT_OUT = "indeterminate: all measurements in the window were left out"


class Solver:
    """Adds measurements to a window and solves it, whatever happens.

    Attributes
    ----------
    diagnostics
        What had to be left out.
    """

    def __init__(self, window: LagWindow) -> None:
        self._window, self._own = window, window.own
        self.diagnostics: list[Diagnostic] = []

    def solve(self, update: GraphUpdate, new: Measurements) -> None:
        """Update the smoother with new measurements; if that fails make it again."""
        failure = self._failure(lambda: self._window.add_measurements(update, new))
        failure = failure or self._failure(lambda: self._window.solve(update))
        if failure is not None:
            self._report(f"{SOLVED_AGAIN} ({failure})")
            self._solve_again()

    def _solve_again(self) -> None:
        """Make a smoother of the window: as it is, then without own factors, then without all."""
        self.diagnostics += self._own.drop_failing(self._window.numbered)
        if self._is_solved():
            return
        if self._own.active:
            if self._without_one_own_factor():
                return
            self._report("indeterminate: factors of your own were left out")
            self._own.active.clear()
            if self._is_solved():
                return
        if self._is_solved(forget=True):
            return
        self._report(LEFT_OUT)
        self._window.predict()
        if not self._is_solved():
            self._window.give_up()

    def _is_solved(self, forget: bool = False) -> bool:
        """Make a smoother of all that is in the window; return whether it can be solved."""
        update = self._window.again(forget)
        return self._failure(lambda: self._window.solve(update)) is None

    def _without_one_own_factor(self) -> bool:
        """Leave out the one factor of a user's own, if any, without which the window is solved."""
        for factor in reversed(tuple(self._own.active)):
            place = self._own.active.index(factor)
            self._own.active.pop(place)
            if self._is_solved():
                key, t = key_name(factor.keys()[0]), float(self._window.keys.t[-1])
                self.diagnostics.append(Diagnostic(key, t, None, f"{OWN_LEFT_OUT}: indeterminate"))
                return True
            self._own.active.insert(place, factor)
        return False

    def _failure(self, call: Callable[[], None]) -> Exception | None:
        """Make a call; return what went wrong if it fails."""
        try:
            call()
        except self._own.failures as error:
            return error
        return None

    def _report(self, reason: str) -> None:
        key, t = key_name(X(self._window.first)), float(self._window.keys.t[0])
        self.diagnostics.append(Diagnostic(key, t, None, reason))
