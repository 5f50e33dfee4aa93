"""A window of states as a GTSAM problem: its graph, initial values, optimum and covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import wnoa_covariance
from gpvo.config.stages import EstimatorConfig
from gpvo.estimator.graph_builder import FactorMaker, landmark_points, nested_dissection
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
ROUNDING = 1e-8
"""Eigenvalue of a correlation matrix that is as good as zero."""
FASTEST = 1e3
"""Body twist beyond which an estimate has diverged, rad/s and m/s."""


@dataclass(frozen=True, eq=False)
class Window:
    """States 0 to K - 1 and the measurements between the first and the last of them.

    Attributes
    ----------
    states
        Times, and the poses and twists to begin with.
    measurements
        Of landmarks that are measured at least twice.
    anchor_covariance
        (12, 12) of the first state's pose and twist, which its priors hold.
    """

    states: States
    measurements: Measurements
    anchor_covariance: Array

    def graph(self, make: FactorMaker) -> gtsam.NonlinearFactorGraph:
        """Priors on the first state, WNOA priors, and reprojection factors."""
        numbers, states = range(len(self.states)), self.states
        graph = gtsam.NonlinearFactorGraph()
        for factor in (
            *make.anchor(0, states.T_world_cam[0], states.twist[0], self.anchor_covariance),
            *make.motion(numbers, states.t),
            *make.reprojection(numbers, states.t, self.measurements),
        ):
            graph.push_back(factor)
        return graph

    def values(self, make: FactorMaker) -> gtsam.Values:
        """The states, and landmarks triangulated from them."""
        values = gtsam.Values()
        for k, (T, twist) in enumerate(
            zip(self.states.T_world_cam, self.states.twist, strict=True)
        ):
            values.insert(X(k), gtsam.Pose3(T))
            values.insert(V(k), twist)
        T_at_measurement, _ = self.states.query(self.measurements.t)
        for landmark, point in landmark_points(self.measurements, T_at_measurement, make.camera):
            values.insert(L(landmark), point)
        return values

    def optimize(self, make: FactorMaker, config: EstimatorConfig) -> States:
        """The states that minimize the cost; RuntimeError if it does not determine them."""
        ordering = nested_dissection(range(len(self.states)), self.states.t, self.measurements)
        values = gauss_newton(self.graph(make), self.values(make), ordering, config)
        return states_of(values, range(len(self.states)), self.states.t)

    def joint_covariances(self, make: FactorMaker, count: int) -> Array:
        """(count, 24, 24) joint covariances of the first states and the next of each."""
        solved = gtsam.ISAM2(isam_parameters())
        solved.update(self.graph(make), self.values(make))
        return joint_covariances(solved, range(count + 1))


def states_of(values: gtsam.Values, numbers: Sequence[int], t: Array) -> States:
    """The states with these numbers (K,) at times t (K,).

    Raises
    ------
    RuntimeError
        If they are not finite or diverge, as GTSAM does if a system is singular and it notices.
    """
    T_world_cam = np.array([values.atPose3(X(k)).matrix() for k in numbers])
    twist = np.array([values.atVector(V(k)) for k in numbers])
    if not (np.isfinite(T_world_cam).all() and (np.abs(twist) < FASTEST).all()):
        raise RuntimeError("the estimate diverges")
    return States(t, T_world_cam, twist)


def gauss_newton(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    ordering: gtsam.Ordering,
    config: EstimatorConfig,
) -> gtsam.Values:
    """Minimize by Gauss-Newton until the cost changes by less than `relative_decrease`.

    The loop is ours because GTSAM's optimizers copy all values for each Python factor; it is QR
    because their Cholesky rejects well-posed chains of states microseconds apart.
    """
    cost = graph.error(values)
    for _ in range(config.iterations):
        linear = graph.linearize(values)
        step = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
        values = values.retract(step)
        previous, cost = cost, graph.error(values)
        if abs(previous - cost) <= config.relative_decrease * previous:
            break
    return values


def isam_parameters() -> gtsam.ISAM2Params:
    """iSAM2 that relinearizes whatever moved, as stiff chains of states need it.

    By QR: GTSAM's Cholesky rejects well-posed systems of states that are microseconds apart.
    """
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    parameters.setRelinearizeThreshold(1e-3)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return parameters


def joint_covariances(solved: gtsam.ISAM2, numbers: Sequence[int]) -> Array:
    """(n - 1, 24, 24) covariances of the poses and twists of states (n,), of each and the next."""
    if len(numbers) < 2:
        return np.empty((0, 24, 24))
    keys = [key(k) for k in numbers for key in (X, V)]
    joint = solved.jointMarginalCovariance(keys)
    pairs = [keys[first : first + 4] for first in range(0, len(keys) - 2, 2)]
    return np.array([np.block([[joint.at(i, j) for j in pair] for i in pair]) for pair in pairs])


def are_covariances(matrices: Array) -> bool:
    """Whether all (n, m, m) are finite and positive semidefinite, up to rounding errors."""
    variances = np.diagonal(matrices, 0, 1, 2)
    if not (np.isfinite(matrices).all() and (variances > 0).all()):
        return False
    scale = 1 / np.sqrt(variances)
    correlations = scale[:, :, None] * matrices * scale[:, None, :]
    return bool(np.linalg.eigvalsh(correlations).min(initial=1.0) > -ROUNDING)


def prior_covariances(first: Array, t: Array, qc: Sequence[float]) -> Array:
    """(n - 1, 24, 24) as above of states at times t (n,) that nothing measures.

    `first` (12, 12) is the first one's covariance. The turn of the body on the way is neglected.
    """
    joint = np.zeros((len(t) - 1, 24, 24))
    for k, dt in enumerate(np.diff(t)):
        transition = np.eye(12) + dt * np.eye(12, k=6)
        both = np.vstack([np.eye(12), transition])
        joint[k] = both @ first @ both.T
        joint[k, 12:, 12:] += wnoa_covariance(dt, qc)
        first = joint[k, 12:, 12:]
    return joint
