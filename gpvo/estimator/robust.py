"""Losses that let measurements be wrong, and the squared errors that they are functions of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import gtsam
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LossName = Literal["none", "huber", "cauchy", "gnc"]


@dataclass(frozen=True)
class RobustLoss:
    """Loss of a measurement by its squared Mahalanobis error s.

    Attributes
    ----------
    name
        none: s; huber: s, and beyond the scale c linear in its root; cauchy: c^2 log(1 + s / c^2);
        gnc: Geman-McClure, m c^2 s / (m c^2 + s), with m falling to one (graduated non-convexity,
        Yang et al., 2020).
    scale
        c, standard deviations of a measurement.
    convexity
        m of gnc; one is the loss itself, and the larger it is the more convex.
    """

    name: LossName = "none"
    scale: float = 3.0
    convexity: float = 1.0

    def cost(self, s: Array) -> Array:
        """Loss (N,) of squared errors (N,)."""
        square = self.scale**2
        if self.name == "huber":
            return np.where(s <= square, s, 2 * self.scale * np.sqrt(s) - square)
        if self.name == "cauchy":
            return square * np.log1p(s / square)
        if self.name == "gnc":
            return self.convexity * square * s / (self.convexity * square + s)
        return s

    def weight(self, s: Array) -> Array:
        """Derivative (N,) of the loss: weights of iteratively reweighted least squares."""
        square = self.scale**2
        if self.name == "huber":
            return self.scale / np.sqrt(np.maximum(s, square))
        if self.name == "cauchy":
            return square / (square + s)
        if self.name == "gnc":
            return (self.convexity * square / (self.convexity * square + s)) ** 2
        return np.ones_like(s)

    def convexified(self, s: Array) -> RobustLoss:
        """The start of graduated non-convexity: a loss that is convex up to the largest of s."""
        if self.name != "gnc" or len(s) == 0:
            return self
        return replace(self, convexity=max(1.0, 2 * float(s.max()) / self.scale**2))

    def less_convex(self) -> RobustLoss:
        """The next loss of graduated non-convexity; itself if it is the last."""
        return replace(self, convexity=max(1.0, self.convexity / 2))

    def noise_model(self, information: Array) -> gtsam.noiseModel.Base:
        """GTSAM's noise model of a measurement with the information matrix (3, 3)."""
        gaussian = gtsam.noiseModel.Gaussian.Information(information)
        if self.name == "none":
            return gaussian
        estimators = gtsam.noiseModel.mEstimator
        losses: dict[str, Any] = {
            "huber": estimators.Huber,
            "cauchy": estimators.Cauchy,
            "gnc": estimators.GemanMcClure,
        }
        return gtsam.noiseModel.Robust.Create(losses[self.name].Create(self.scale), gaussian)
