"""GTSAM's incremental solvers as states that are close in time and factors in Python need them.

Three things are set by default in GTSAM that such graphs do not survive: Cholesky, which refuses
well-posed chains of states that are microseconds apart; relinearisation only after large steps and
every tenth update; and copying all values into each callback.
"""

from __future__ import annotations

from typing import Protocol

import gtsam

from factors.kernels import Array


class JointMarginal(Protocol):
    """Blocks of a joint covariance: gtsam.JointMarginal."""

    def at(self, row: int, column: int, /) -> Array:
        """Return the block of two keys."""


class JointMarginals(Protocol):
    """What knows joint covariances: gtsam.Marginals, gtsam.ISAM2."""

    def jointMarginalCovariance(self, variables: list[int], /) -> JointMarginal:
        """Return the joint covariance of variables."""


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


def joint_marginals(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.ISAM2:
    """Solve a graph linearised at the values by QR; the result knows all joint covariances."""
    solver = gtsam.ISAM2(isam2_parameters())
    held = solver.getLinearizationPoint()  # while Python holds it GTSAM copies no values
    solver.update(graph, values)
    del held
    return solver
