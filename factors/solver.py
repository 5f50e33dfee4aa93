"""Gauss-Newton optimization, driven from Python.

When GTSAM's own optimisers call back into Python they copy all values for each factor, at a cost
that grows with the number of variables. Here Python owns the values and nothing is copied. The
linear system is solved by QR, because GTSAM 4.3's Cholesky refuses well-posed chains of states that
are close in time.
"""

from __future__ import annotations

import math

import gtsam


def optimize(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    max_iterations: int = 20,
    tolerance: float = 1e-9,
    ordering: gtsam.Ordering | None = None,
) -> gtsam.Values:
    """Find the values at the least-squares optimum of a graph by Gauss-Newton.

    Parameters
    ----------
    graph
        Any GTSAM factors, native or written in Python.
    values
        Initial values; not changed.
    max_iterations
        Largest number of steps.
    tolerance
        Stop when a step changes the error by at most tolerance * max(1, error before the step).
    ordering
        Elimination order of all variables; by COLAMD if none is given.

    Raises
    ------
    ValueError
        If the error is infinite or not a number, at the start or after a step.
    RuntimeError
        From GTSAM, naming the variable, if the measurements do not determine it.
    """
    if ordering is None:
        ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
    error = _finite(graph.error(values))
    for _ in range(max_iterations):
        linear = graph.linearize(values)
        step = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
        values = values.retract(step)
        before, error = error, _finite(graph.error(values))
        if abs(before - error) <= tolerance * max(1.0, before):
            break
    return values


def _finite(error: float) -> float:
    """Return the error itself, or raise ValueError if it is not finite."""
    if not math.isfinite(error):
        raise ValueError("values have no finite error: too far from the optimum to start, or lost")
    return error
