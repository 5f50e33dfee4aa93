"""Pose, velocity and covariance between and beyond states, by the WNOA Gaussian process.

Section III-C.2 of Wang and Gammell; Barfoot, "State Estimation for Robotics", chapter 11.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Poses, are_semidefinite, checked_array, checked_poses
from factors.kernels.compiled import kernel
from factors.kernels.local_variables import (
    hermite_weights,
    interpolated_local_kernel,
    local_state_kernel,
    retract_kernel,
    wnoa_kernel,
)
from factors.kernels.se3 import Array, compose_exp_kernel
from factors.wnoa import information_root, kronecker, whitening


class InterpolatedState(NamedTuple):
    """Pose (..., 4, 4), body twist (..., 6) and, if requested, their covariance (..., 12, 12).

    The covariance is that of a right perturbation of the pose, rotation first, and of the twist.
    """

    pose: Array
    velocity: Array
    covariance: Array | None


def interpolate(
    T_i: Poses,
    v_i: ArrayLike,
    T_j: Poses,
    v_j: ArrayLike,
    t_i: ArrayLike,
    t_j: ArrayLike,
    t: ArrayLike,
    qc: ArrayLike | None = None,
    joint_covariance: ArrayLike | None = None,
) -> InterpolatedState:
    """Interpolate the state at times t between states i and j, with common leading axes.

    Parameters
    ----------
    T_i, T_j
        (..., 4, 4) poses T_world_body, or gtsam.Pose3.
    v_i, v_j
        (..., 6) body twists, rotation first.
    t_i, t_j, t
        (...) seconds, t_i <= t <= t_j and t_i < t_j.
    qc
        Power spectral density, (6,) or (6, 6); needed with a covariance.
    joint_covariance
        (..., 24, 24) of T_i, v_i, T_j, v_j.

    Notes
    -----
    The covariance is exact for the joint covariance of a graph that contains the state at t, with a
    prior on either side of it. A graph with one prior from t_i to t_j has a slightly different
    joint covariance, because the prior is not linear. The relative difference of the variance in
    any direction falls with the square of t_j - t_i if the acceleration is bounded: thousandths at
    0.1 s and 1 rad/s, 1e-4 at 25 ms.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, the times are out of order, or a
        covariance is given without qc or is not positive semidefinite.
    """
    T_i, T_j = checked_poses("T_i", T_i), checked_poses("T_j", T_j)
    v_i, v_j = checked_array("v_i", v_i, (6,)), checked_array("v_j", v_j, (6,))
    t_i, t_j = checked_array("t_i", t_i, ()), checked_array("t_j", t_j, ())
    t = checked_array("t", t, ())
    shapes = T_i.shape[:-2], v_i.shape[:-1], T_j.shape[:-2], v_j.shape[:-1]
    joint = _checked_covariance("joint_covariance", joint_covariance, 24)
    batch = np.broadcast_shapes(t_i.shape, t_j.shape, t.shape, *shapes, joint.shape[:-2])
    if not (np.all(t_i < t_j) and np.all(t_i <= t) and np.all(t <= t_j)):
        raise ValueError("t must lie between t_i and t_j, and t_i before t_j")
    T_i, T_j = _spread(T_i, batch, (4, 4)), _spread(T_j, batch, (4, 4))
    v_i, v_j = _spread(v_i, batch, (6,)), _spread(v_j, batch, (6,))
    a, b = _spread(t - t_i, batch, ()), _spread(t_j - t, batch, ())
    pose, velocity = np.empty((len(a), 4, 4)), np.empty((len(a), 6))
    _interpolate_batch(T_i, v_i, T_j, v_j, a, b, pose, velocity)
    covariance = None
    if joint_covariance is not None:
        if qc is None:
            raise ValueError("qc is needed to interpolate a covariance")
        root = _spread(_square_root(joint), batch, (24, 24))
        W = whitening(qc)
        from_i = _whitened_prior(T_i, v_i, pose, velocity, a, W)
        to_j = _whitened_prior(pose, velocity, T_j, v_j, b, W)
        covariance = _between(from_i, to_j, root)
        joint = _spread(joint, batch, (24, 24))
        covariance[a == 0], covariance[b == 0] = joint[a == 0, :12, :12], joint[b == 0, 12:, 12:]
        covariance = covariance.reshape(*batch, 12, 12)
    return InterpolatedState(pose.reshape(*batch, 4, 4), velocity.reshape(*batch, 6), covariance)


def _checked_covariance(name: str, covariance: ArrayLike | None, size: int) -> Array:
    """Return covariances (..., size, size), finite; zero if there are none."""
    found = np.zeros((size, size)) if covariance is None else covariance
    return checked_array(name, found, (size, size))


@kernel
def _interpolate_batch(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: Array, b: Array, T: Array, v: Array
) -> None:
    for n in range(len(a)):
        local_j = local_state_kernel(T_i[n], T_j[n], v_j[n])
        local = interpolated_local_kernel(v_i[n], local_j, hermite_weights(a[n], b[n]))
        retract_kernel(T_i[n], local, T[n], v[n])


@kernel
def _extrapolate_batch(T_i: Array, v_i: Array, dt: Array, T: Array) -> None:
    for n in range(len(dt)):
        compose_exp_kernel(T_i[n], dt[n] * v_i[n], T[n])


def _whitened_prior(T_i: Array, v_i: Array, T_j: Array, v_j: Array, dt: Array, W: Array) -> Array:
    """Compute the Jacobian of the prior's whitened error with respect to both states, (n, 12, 24).

    The states i and j are dt (n,) seconds apart. A duration of zero is replaced by one second; its
    rows are not used.
    """
    dt = np.where(dt == 0, 1.0, dt)
    rows = zip(T_i, v_i, T_j, v_j, dt, strict=True)
    derivatives = np.array([wnoa_kernel(*row) for row in rows])
    derivatives = derivatives.reshape(-1, 12, 25)
    return kronecker(information_root(dt), W) @ derivatives[..., :24]


def _between(from_i: Array, to_j: Array, root: Array) -> Array:
    """Compute the covariance (n, 12, 12) of a state that two priors tie to states i and j.

    Their joint covariance is given by its square root (n, 24, 24). The result is a sum of squares,
    so it is positive semidefinite.
    """
    gain, own = given_states(from_i, to_j)
    return _sum_of_squares(gain @ root, own)


def given_states(from_i: Array, to_j: Array) -> tuple[Array, Array]:
    """Compute the conditional distribution of a state given states i and j, from two priors.

    The state is treated like one of the graph: QR of the whitened Jacobians (n, m, 2 m) of both
    yields its gain (n, m, 2 m) and the square root (n, m, m) of its own covariance.
    """
    m = from_i.shape[1]
    own = np.concatenate([from_i[..., m:], to_j[..., :m]], axis=1)
    others = np.zeros((len(own), 2 * m, 2 * m))
    others[:, :m, :m], others[:, m:, m:] = from_i[..., :m], to_j[..., m:]
    Q, R = np.linalg.qr(own)
    inverse = np.linalg.inv(R)
    return inverse @ (np.swapaxes(Q, 1, 2) @ others), inverse


def _square_root(covariance: Array) -> Array:
    """Compute L (..., m, m) with LLᵀ = covariance, which may be singular up to rounding."""
    try:
        return np.asarray(np.linalg.cholesky(covariance), np.float64)
    except np.linalg.LinAlgError:
        eigenvalues, vectors = np.linalg.eigh(covariance)
    if not are_semidefinite(eigenvalues):
        raise ValueError("covariance must be positive semidefinite")
    root: Array = vectors * np.sqrt(np.maximum(eigenvalues, 0))[..., None, :]
    return root


def _sum_of_squares(*roots: Array) -> Array:
    """Compute the sum of LLᵀ (n, m, m) over the roots L (n, m, k)."""
    root = np.concatenate(roots, axis=-1)
    total: Array = root @ np.swapaxes(root, -1, -2)
    return total


def _spread(array: Array, batch: tuple[int, ...], element: tuple[int, ...]) -> Array:
    """Broadcast the leading axes of an array to `batch` and flatten them.

    The result is a copy, because numba would compile all kernels again for the read-only view that
    NumPy's broadcasting returns.
    """
    whole = np.array(np.broadcast_to(array, (*batch, *element)), order="C")
    return whole.reshape(-1, *element)


def extrapolate(
    T_i: Poses,
    v_i: ArrayLike,
    dt: ArrayLike,
    qc: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> InterpolatedState:
    """Extrapolate state i by dt seconds, of either sign, at constant body velocity.

    Parameters
    ----------
    T_i, v_i
        (..., 4, 4) pose T_world_body, or gtsam.Pose3, and (..., 6) body twist.
    dt
        (...) seconds.
    qc
        Power spectral density, (6,) or (6, 6); needed with a covariance.
    covariance
        (..., 12, 12) of T_i and v_i.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, or a covariance is given without qc or
        is not positive semidefinite.
    """
    T_i, v_i = checked_poses("T_i", T_i), checked_array("v_i", v_i, (6,))
    dt = checked_array("dt", dt, ())
    start = _checked_covariance("covariance", covariance, 12)
    batch = np.broadcast_shapes(dt.shape, T_i.shape[:-2], v_i.shape[:-1], start.shape[:-2])
    T_i, v_i, dt = _spread(T_i, batch, (4, 4)), _spread(v_i, batch, (6,)), _spread(dt, batch, ())
    pose, velocity = np.empty((len(dt), 4, 4)), v_i  # constant, in the body's frame
    _extrapolate_batch(T_i, v_i, dt, pose)
    result = None
    if covariance is not None:
        if qc is None:
            raise ValueError("qc is needed to extrapolate a covariance")
        W = whitening(qc)
        ahead = _whitened_prior(T_i, v_i, pose, velocity, np.maximum(dt, 0), W)
        behind = _whitened_prior(pose, velocity, T_i, v_i, np.maximum(-dt, 0), W)
        own = np.where(dt[:, None, None] > 0, ahead[..., 12:], behind[..., :12])
        other = np.where(dt[:, None, None] > 0, ahead[..., :12], behind[..., 12:])
        inverse = np.linalg.inv(own)
        root = _spread(_square_root(start), batch, (12, 12))
        result = _sum_of_squares(inverse @ other @ root, inverse)
        result[dt == 0] = _spread(start, batch, (12, 12))[dt == 0]
        result = result.reshape(*batch, 12, 12)
    return InterpolatedState(pose.reshape(*batch, 4, 4), velocity.reshape(*batch, 6), result)
