"""Robust losses of GTSAM, of many errors at once, and with the second derivative.

GTSAM gives Python the loss of one error a call, and no second derivative. Huber's, Cauchy's and
Geman-McClure's are therefore written down here; all others are asked of GTSAM.
"""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from factors.kernels.compiled import bare_kernel, kernel
from factors.kernels.se3 import Array

SQUARE, HUBER, CAUCHY, GEMAN_MCCLURE = 0.0, 1.0, 2.0, 3.0
_INCREASING = np.geomspace(1e-3, 1e3, 61)
_FAR = 2.0**100  # no rounding: a power of two


class Loss:
    """The loss of a noise model: half the square for Gaussian ones.

    Attributes
    ----------
    parameters
        (2,) kind and scale, for the kernels; SQUARE for a loss that they do not know.
    other
        GTSAM's loss if the kernels do not know it: they then take its weights.

    Raises
    ------
    ValueError
        If larger errors weigh more, as in L2WithDeadZone: repeated weighting then finds no optimum.
    """

    def __init__(self, model: gtsam.noiseModel.Base) -> None:
        robust = model.robust() if isinstance(model, gtsam.noiseModel.Robust) else None
        self.parameters = _parameters(robust)
        self.other: Any = robust if self.parameters[0] == SQUARE else None
        if self.other is not None and (np.diff(self.weights(_INCREASING)) > 1e-9).any():
            kind = type(self.other).__name__
            raise ValueError(f"model must not give larger errors more weight, as {kind} does")

    def weights(self, distances: Array) -> Array:
        """(n,) weights of the squared errors, of the norms (n,) of whitened errors."""
        if self.other is not None:
            return np.array([self.other.weight(d) for d in distances])
        if self.parameters[0] == SQUARE:
            return np.ones(len(distances))
        return losses_kernel(distances, self.parameters)[1]

    def total(self, distances: Array) -> float:
        """Sum of the losses."""
        if self.other is not None:
            return float(sum(self.other.loss(d) for d in distances))
        return float(losses_kernel(distances, self.parameters)[0].sum())


def _parameters(robust: Any) -> Array:
    """Kind and scale. GTSAM does not tell the scale; far out it is all that the weight depends on.

    There the weights are k / d, k^2 / d^2 and k^4 / d^4.
    """
    kinds = gtsam.noiseModel.mEstimator
    for kind, power, name in (
        (HUBER, 1, kinds.Huber),
        (CAUCHY, 2, kinds.Cauchy),
        (GEMAN_MCCLURE, 4, kinds.GemanMcClure),
    ):
        if isinstance(robust, name):
            return np.array([kind, (robust.weight(_FAR) * _FAR**power) ** (1 / power)])
    return np.array([SQUARE, 1.0])


@kernel
def losses_kernel(distances: Array, parameters: Array) -> tuple[Array, Array]:
    """Losses (n,) and weights (n,)."""
    losses, weights = np.empty(len(distances)), np.empty(len(distances))
    for n in range(len(distances)):
        losses[n], weights[n], _ = loss_kernel(distances[n] ** 2, parameters)
    return losses, weights


@bare_kernel
def loss_kernel(square: float, parameters: Array) -> tuple[float, float, float]:
    """The loss of an error d of this square, its weight loss'(d) / d, and loss''(d)."""
    kind, k2 = parameters[0], parameters[1] * parameters[1]
    if kind == HUBER and square > k2:
        d = np.sqrt(square)
        return parameters[1] * (d - 0.5 * parameters[1]), parameters[1] / d, 0.0
    if kind == CAUCHY:
        share = k2 / (k2 + square)
        return 0.5 * k2 * np.log1p(square / k2), share, share * (2 * share - 1)
    if kind == GEMAN_MCCLURE:
        share = k2 / (k2 + square)
        return 0.5 * share * square, share**2, share**2 * (4 * share - 3)
    return 0.5 * square, 1.0, 1.0
