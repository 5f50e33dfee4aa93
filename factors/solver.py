"""Gauss-Newton, driven from Python.

When GTSAM's own optimisers call back into Python they copy all values for each factor, which costs
more with each variable. Here Python owns the values, nothing is copied, and the linear system is
solved by QR: GTSAM 4.3's Cholesky refuses well-posed chains of states that are close in time.
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
    """Values at the least squares optimum of a graph, found by Gauss-Newton.

    Parameters
    ----------
    graph
        Any GTSAM factors, Python's and native ones.
    values
        Where to start; not changed.
    max_iterations
        Largest number of steps.
    tolerance
        Stop when a step lowers the error by less than this share of it, or less than this.
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
    """The error itself, or ValueError if no step can come of it."""
    if not math.isfinite(error):
        raise ValueError("values have no finite error: too far from the optimum to start, or lost")
    return error
