"""Gauss-Newton over a window, with a fixed linearization of what has left it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpvo.config.stages import EstimatorConfig
from gpvo.estimator.gaussian import IndeterminateError, Quadratic
from gpvo.estimator.window_cost import Variables, WindowCost

Array = NDArray[np.float64]
ROUNDING = 1e-12
"""Costs, squared standard deviations, that differ by less are the same."""


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
    depth
        (N,) depths of the landmarks in the cameras that measured them.
    """

    variables: Variables
    cost: WindowCost
    linearized: Variables
    quadratic: Quadratic
    depth: Array

    @property
    def hidden(self) -> NDArray[np.int64]:
        """Numbers of the landmarks that are behind the camera at one of their measurements."""
        return np.unique(self.cost.measurements.landmark[~(self.depth > 0)])


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
        # At its minimum a quadratic cost has fallen by half of its linear part.
        variables, predicted = linearized.moved(step), quadratic.c + float(quadratic.g @ step)
        value, depth = cost.value_and_depths(variables)
        if not np.isfinite(value):
            raise IndeterminateError(_lost(cost, variables))
        loss = cost.loss.less_convex()
        tolerance = max(config.relative_decrease * value, ROUNDING)
        if loss == cost.loss and abs(predicted - value) <= tolerance:
            break
    if value > 2 * lowest + 1 + len(cost.measurements):
        raise IndeterminateError(variables.first_state)
    return Optimum(variables, cost, linearized, quadratic, depth)


def _lost(cost: WindowCost, variables: Variables) -> int:
    """Column of the first landmark whose error is not finite, or of the states if all are."""
    wrong = ~np.isfinite(cost.squared_errors(variables))
    if not wrong.any():
        return variables.first_state
    landmark = variables.landmarks.index(cost.measurements.landmark[wrong])
    return int(variables.columns.landmark[landmark[0]])
