"""Gauss-Newton over a window, with a fixed linearization of what has left it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpvo.config import EstimatorConfig
from gpvo.gaussian import IndeterminateError, Quadratic
from gpvo.window_cost import Variables, WindowCost


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best variables, and the quadratic cost around those before the last step.

    Attributes
    ----------
    variables
        Estimate.
    cost
        With the loss of the last step.
    linearized, quadratic
        Where the cost was linearized, and the cost of a step from there on.
    """

    variables: Variables
    cost: WindowCost
    linearized: Variables
    quadratic: Quadratic


def minimize(cost: WindowCost, variables: Variables, config: EstimatorConfig) -> Optimum:
    """Minimize by Gauss-Newton until the cost is what its quadratic approximation predicted.

    If both differ by less than `relative_decrease`, another step would gain no more than that. The
    paper takes that step to see it.

    Raises
    ------
    IndeterminateError
        If the measurements and priors do not determine the variables, or steps lead uphill.
    """
    loss = cost.loss
    if loss.name == "gnc":
        loss = loss.convexified(cost.squared_errors(variables))
    lowest = np.inf
    for _ in range(config.iterations):
        cost = replace(cost, loss=loss)
        linearized = cost.linearization_point(variables)
        quadratic = cost.quadratic(linearized)
        lowest = min(lowest, quadratic.c)
        step = quadratic.minimum()
        variables, predicted = linearized.moved(step), quadratic.cost(step)
        value = cost.value(variables)
        if not np.isfinite(value):
            raise IndeterminateError(_lost(cost, variables))
        loss = cost.loss.less_convex()
        if loss == cost.loss and abs(predicted - value) <= config.relative_decrease * value:
            break
    if value > 2 * lowest + len(cost.measurements):
        raise IndeterminateError(0)
    return Optimum(variables, cost, linearized, quadratic)


def _lost(cost: WindowCost, variables: Variables) -> int:
    """First column of the first landmark whose error is not finite; 0 if it is a state's fault."""
    wrong = ~np.isfinite(cost.squared_errors(variables))
    if not wrong.any():
        return 0
    landmark = variables.landmarks.index(cost.measurements.landmark[wrong])
    return variables.first_landmark + 3 * int(landmark[0])
