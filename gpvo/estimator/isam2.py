"""GTSAM's incremental fixed-lag smoother of the key states, and what is read from it."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import isam2_parameters, wnoa_covariance
from gpvo.estimator.graph_update import GraphUpdate
from gpvo.estimator.state_times import SAME_TIME
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
FAILURES = (RuntimeError, IndexError, ValueError)
"""What GTSAM raises if a system is singular or a variable is missing."""
ROUNDING = 1e-8
"""Eigenvalue of a correlation matrix that is as good as zero."""
FASTEST = 1e3
"""Body twist beyond which an estimate has diverged, rad/s and m/s."""


class KeyStateSmoother:
    """Linearises all at the latest estimate in each update.

    What leaves the window is then marginalised at the point at which its landmarks' prior was made.
    """

    def __init__(self) -> None:
        parameters = isam2_parameters(relinearize_threshold=0.0)
        self._smoother = gtsam.IncrementalFixedLagSmoother(np.inf, parameters)
        # While Python holds it, GTSAM does not copy all values for each factor written in Python.
        self._linearization_point = self._smoother.getLinearizationPoint()
        # Callbacks are faster for factors that Python keeps alive, by the time of the update.
        self._alive: dict[float, list[gtsam.NonlinearFactor]] = {}
        self._covariance: Array | None = None  # needed several times between two updates

    @property
    def factors(self) -> gtsam.NonlinearFactorGraph:
        """Factors by their index, None where one was removed."""
        return self._smoother.getFactors()

    def update(
        self, update: GraphUpdate, t: float, leave_before: float, more_steps: int
    ) -> Sequence[int]:
        """Add what is new at time t, let go the states before another one, and iterate.

        Returned are the indices of the factors that were added.
        """
        self._covariance = None
        self._alive = {at: kept for at, kept in self._alive.items() if at >= leave_before}
        self._alive[t] = self._alive.get(t, []) + update.factors
        self._smoother.setSmootherLag(t - leave_before + SAME_TIME)
        self._smoother.update(update.graph, update.values, update.stamps, update.removed)
        added: Sequence[int] = self._smoother.getISAM2Result().getNewFactorsIndices()
        for _ in range(more_steps):
            self._smoother.update()
        return added

    def states(self, numbers: Sequence[int], t: Array) -> States:
        """Return the states with these numbers (K,) at times t (K,), see `states_of`."""
        return states_of(self._smoother.calculateEstimate(), numbers, t)

    def linearized(self, numbers: Sequence[int], t: Array) -> States | None:
        """Return the states at which the covariance was found; None if GTSAM does not have them."""
        try:
            return states_of(self._linearization_point, numbers, t)
        except FAILURES:
            return None

    def covariance(self, numbers: Sequence[int]) -> Array | None:
        """Return (12 K, 12 K) of the states that were solved; None if GTSAM has none."""
        if self._covariance is None:
            try:
                covariance = joint_covariance(self._smoother.getISAM2(), numbers)
            except FAILURES:
                return None
            self._covariance = covariance if np.isfinite(covariance).all() else None
        return self._covariance


def states_of(values: gtsam.Values, numbers: Sequence[int], t: Array) -> States:
    """Read the states with these numbers (K,) at times t (K,).

    Raises
    ------
    RuntimeError
        If they are not finite or diverge, as GTSAM does if it notices a singular system.
    """
    T_world_cam = np.array([values.atPose3(X(k)).matrix() for k in numbers])
    twist = np.array([values.atVector(V(k)) for k in numbers])
    if not (np.isfinite(T_world_cam).all() and (np.abs(twist) < FASTEST).all()):
        raise RuntimeError("the estimate diverges")
    return States(t, T_world_cam, twist)


def joint_covariance(solved: gtsam.ISAM2, numbers: Sequence[int]) -> Array:
    """Return the (12 n, 12 n) covariance of the poses and twists of states (n,)."""
    keys = [key(k) for k in numbers for key in (X, V)]
    try:
        net = solved.jointBayesNet(keys)  # half the time of GTSAM's own joint covariance
    except RuntimeError:  # which bears worse conditioned systems
        return np.asarray(solved.jointMarginalCovariance(keys).fullMatrix(), np.float64)
    root = np.linalg.inv(net.matrix()[0])
    places = np.array([keys.index(net.at(k).firstFrontalKey()) for k in range(net.size())])
    columns = (6 * places[:, None] + np.arange(6)).ravel()
    covariance = np.empty_like(root)
    covariance[columns[:, None], columns] = root @ root.T
    return covariance


def blocks_of_neighbours(covariance: Array) -> Array:
    """Return the (n - 1, 24, 24) blocks of each state and the next of a (12 n, 12 n) covariance."""
    first = 12 * np.arange(len(covariance) // 12 - 1)
    rows = first[:, None] + np.arange(24)
    return covariance[rows[:, :, None], rows[:, None, :]]


def are_covariances(matrices: Array) -> bool:
    """Return whether all (n, m, m) are finite and positive semidefinite, up to rounding errors."""
    variances = np.diagonal(matrices, 0, 1, 2)
    if not (np.isfinite(matrices).all() and (variances > 0).all()):
        return False
    scale = 1 / np.sqrt(variances)
    correlations = scale[:, :, None] * matrices * scale[:, None, :]
    return bool(np.linalg.eigvalsh(correlations).min(initial=1.0) > -ROUNDING)


def prior_covariance(first: Array, t: Array, qc: Sequence[float]) -> Array:
    """Return the (12 n, 12 n) covariance of states at times t (n,) that nothing measures.

    `first` (12, 12) is the first one's covariance. The turn of the body on the way is neglected.
    """
    count = len(t)
    covariance = np.zeros((12 * count, 12 * count))
    covariance[:12, :12] = first
    for k, dt in enumerate(np.diff(t)):
        before, here = slice(0, 12 * k + 12), slice(12 * k + 12, 12 * k + 24)
        transition = np.eye(12) + dt * np.eye(12, k=6)
        last = slice(12 * k, 12 * k + 12)
        covariance[here, before] = transition @ covariance[last, before]
        covariance[before, here] = covariance[here, before].T
        moved = transition @ covariance[last, last] @ transition.T
        covariance[here, here] = moved + wnoa_covariance(dt, qc)
    return covariance
