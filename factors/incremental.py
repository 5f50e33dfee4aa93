"""GTSAM's incremental solvers as states that are close in time and factors in Python need them.

Three things are set by default in GTSAM that such graphs do not survive: Cholesky, which refuses
well-posed chains of states that are microseconds apart; relinearisation only after large steps and
every tenth update; and copying all values into each callback.
"""

from __future__ import annotations

from typing import Any

import gtsam

from factors.checks import checked_duration, checked_number, key_name
from factors.factor import check_values


def isam2_parameters(relinearize_threshold: float = 1e-3) -> gtsam.ISAM2Params:
    """Make parameters of ISAM2 for states that are close in time.

    QR, relinearisation at every update of what moved by more than the threshold (GTSAM's default is
    0.1 at every tenth), exact steps, and slots of removed factors that are used again.
    """
    parameters, steps = gtsam.ISAM2Params(), gtsam.ISAM2GaussNewtonParams()
    steps.setWildfireThreshold(0.0)
    parameters.setOptimizationParams(steps)
    parameters.setFactorization("QR")
    parameters.setRelinearizeThreshold(relinearize_threshold)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters


class Incremental:
    """One of GTSAM's incremental solvers that can be used with factors written in Python.

    It holds the values of the solver in Python, without which GTSAM copies all of them into each
    callback, and checks the new factors before an update, because an error inside one would leave
    the solver unusable. All else is the solver's own: `calculateEstimate()`, `getFactors()`, ...

    Attributes
    ----------
    solver
        The gtsam.ISAM2 or gtsam.IncrementalFixedLagSmoother.
    """

    def __init__(self, solver: gtsam.ISAM2 | gtsam.IncrementalFixedLagSmoother) -> None:
        self.solver: Any = solver
        self._held = solver.getLinearizationPoint()

    def __getattr__(self, name: str) -> Any:
        if name == "solver":  # while a copy is made
            raise AttributeError(name)
        return getattr(self.solver, name)

    def update(
        self,
        graph: gtsam.NonlinearFactorGraph | None = None,
        values: gtsam.Values | None = None,
        *others: Any,
        **named: Any,
    ) -> Any:
        """Update the solver with new factors and values, and what else its own `update` takes.

        Of a smoother that is `timestamps` first: seconds, by key.

        Raises
        ------
        ValueError
            Naming the factor or the variable, if a factor cannot be linearised at the values, a key
            is there already, or a smoother gets no time for one. The solver is then as it was.
        """
        graph = gtsam.NonlinearFactorGraph() if graph is None else graph
        values = gtsam.Values() if values is None else values
        timed = isinstance(self.solver, gtsam.IncrementalFixedLagSmoother)
        if timed and not others:
            others = (named.pop("timestamps", {}),)
        for key in values.keys():  # noqa: SIM118
            name = key_name(key)
            if self._held.exists(key):
                raise ValueError(f"{name} is in the solver already")
            if timed and key not in others[0]:
                raise ValueError(f"{name} must have a time in the time stamps")
            if timed:
                checked_number(f"the time of {name}", others[0][key])
        both = gtsam.Values(self._held)
        both.insert(values)
        check_values(graph, both)
        return self.solver.update(graph, values, *others, **named)


def isam2(parameters: gtsam.ISAM2Params | None = None) -> Incremental:
    """Make a gtsam.ISAM2 for factors written in Python, with `isam2_parameters` by default."""
    return Incremental(gtsam.ISAM2(isam2_parameters() if parameters is None else parameters))


def fixed_lag_smoother(lag: float, parameters: gtsam.ISAM2Params | None = None) -> Incremental:
    """Make a gtsam.IncrementalFixedLagSmoother for factors written in Python.

    `lag` is in seconds of the time stamps; the parameters are `isam2_parameters` by default.

    Raises
    ------
    ValueError
        If the lag is not positive and finite.
    """
    lag = checked_duration(lag, "lag")
    parameters = isam2_parameters() if parameters is None else parameters
    return Incremental(gtsam.IncrementalFixedLagSmoother(lag, parameters))


def joint_marginals(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.ISAM2:
    """Solve a graph linearised at the values by QR; the result knows all joint covariances."""
    solver = isam2()
    solver.update(graph, values)
    found: gtsam.ISAM2 = solver.solver
    return found
