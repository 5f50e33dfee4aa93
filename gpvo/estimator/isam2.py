"""What is read from the solution of GTSAM's iSAM2."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import wnoa_covariance
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
FAILURES = (RuntimeError, IndexError, ValueError)
"""What GTSAM raises if a system is singular or a variable is missing."""
ROUNDING = 1e-8
"""Eigenvalue of a correlation matrix that is as good as zero."""
FASTEST = 1e3
"""Body twist beyond which an estimate has diverged, rad/s and m/s."""


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


def insert_states(values: gtsam.Values, numbers: Sequence[int], states: States) -> None:
    """Insert states with these numbers (K,): X(k), a Pose3, and V(k)."""
    for k, T, twist in zip(numbers, states.T_world_cam, states.twist, strict=True):
        values.insert(X(k), gtsam.Pose3(T))
        values.insert(V(k), twist)


def joint_covariance(solved: gtsam.ISAM2, numbers: Sequence[int]) -> Array:
    """Return the (12 n, 12 n) covariance of the poses and twists of states (n,)."""
    keys = [key(k) for k in numbers for key in (X, V)]
    net = solved.jointBayesNet(keys)  # half the time of GTSAM's own joint covariance
    root = np.linalg.inv(net.matrix()[0])
    places = np.array([keys.index(net.at(k).firstFrontalKey()) for k in range(net.size())])
    columns = (6 * places[:, None] + np.arange(6)).ravel()
    covariance = np.empty_like(root)
    covariance[columns[:, None], columns] = root @ root.T
    return covariance


def pairs_of_neighbours(covariance: Array) -> Array:
    """Return the (n - 1, 24, 24) blocks of each state and the next from a (12 n, 12 n) one."""
    pairs = 12 * np.arange(len(covariance) // 12 - 1)[:, None] + np.arange(24)
    return covariance[pairs[:, :, None], pairs[:, None, :]]


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
