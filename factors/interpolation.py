"""Pose, velocity and covariance between and beyond states, by the WNOA Gaussian process.

Section III-C.2 of Wang and Gammell; Barfoot, "State Estimation for Robotics", chapter 11.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from factors.checks import power_spectral_density
from factors.kernels import Array, copy_kernel, kernel
from factors.local import (
    EXACT,
    backward_adjoint_kernel,
    hermite_weights,
    interpolated_local_kernel,
    local_by_states_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    moved_jacobian_kernel,
    moved_kernel,
)
from factors.wnoa import kronecker


class InterpolatedState(NamedTuple):
    """Pose (..., 4, 4), body twist (..., 6) and their covariance (..., 12, 12) if it was asked for.

    The covariance is that of a right perturbation of the pose, rotation first, and of the twist.
    """

    pose: Array
    velocity: Array
    covariance: Array | None


def interpolate(
    T_i: ArrayLike,
    v_i: ArrayLike,
    T_j: ArrayLike,
    v_j: ArrayLike,
    t_i: ArrayLike,
    t_j: ArrayLike,
    t: ArrayLike,
    qc: ArrayLike | None = None,
    joint_covariance: ArrayLike | None = None,
) -> InterpolatedState:
    """State at times t between states i and j; all arguments may have common leading axes.

    Parameters
    ----------
    T_i, T_j
        (..., 4, 4) poses T_world_body.
    v_i, v_j
        (..., 6) body twists, rotation first.
    t_i, t_j, t
        (...) seconds, t_i <= t <= t_j and t_i < t_j.
    qc
        Power spectral density, (6,) or (6, 6); needed with a covariance.
    joint_covariance
        (..., 24, 24) of T_i, v_i, T_j, v_j.

    Raises
    ------
    ValueError
        If the times are out of order, or a covariance is given without qc.
    """
    t_i, t_j, t = (np.asarray(x, np.float64) for x in (t_i, t_j, t))
    batch = np.broadcast_shapes(t_i.shape, t_j.shape, t.shape, np.shape(v_i)[:-1])
    if not (np.all(t_i < t_j) and np.all(t_i <= t) and np.all(t <= t_j)):
        raise ValueError("t must lie between t_i and t_j, and t_i before t_j")
    T_i, T_j = _spread(T_i, batch, (4, 4)), _spread(T_j, batch, (4, 4))
    v_i, v_j = _spread(v_i, batch, (6,)), _spread(v_j, batch, (6,))
    a, b = _spread(t - t_i, batch, ()), _spread(t_j - t, batch, ())
    local = np.empty((len(a), 12))
    _interpolate_batch(T_i, v_i, T_j, v_j, a, b, local)
    covariance = None
    if joint_covariance is not None:
        if qc is None:
            raise ValueError("qc is needed to interpolate a covariance")
        local_by_states = np.empty((len(a), 12, 24))
        _local_by_states_batch(T_i, T_j, v_j, a, b, local_by_states)
        joint = _spread(joint_covariance, batch, (24, 24))
        bridge = kronecker(bridge_covariance(a, b), power_spectral_density(qc))
        covariance = _moved_covariance(local, local_by_states, joint, bridge)
    return _moved_state(T_i, local, covariance, batch)


@kernel
def _interpolate_batch(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: Array, b: Array, local: Array
) -> None:
    for n in range(len(a)):
        local_j = local_state_kernel(T_i[n], T_j[n], v_j[n])
        between = interpolated_local_kernel(v_i[n], local_j, hermite_weights(a[n], b[n]))
        for i in range(12):
            local[n, i] = between[i]


@kernel
def _local_by_states_batch(
    T_i: Array, T_j: Array, v_j: Array, a: Array, b: Array, derivatives: Array
) -> None:
    for n in range(len(a)):
        local_j = local_state_kernel(T_i[n], T_j[n], v_j[n])
        by_states_j = local_jacobian_kernel(local_j, v_j[n], EXACT)
        weights = hermite_weights(a[n], b[n])
        copy_kernel(local_by_states_kernel(by_states_j, weights), derivatives[n])


def bridge_covariance(a: Array, b: Array) -> Array:
    """(n, 2, 2) covariance of (xi, w) given both states, per unit of power spectral density.

    The times a (n,) after state i and b (n,) before state j are in seconds.
    """
    dt = a + b
    s, r = a / dt, b / dt
    cross = a * b * s * r * (b - a) / (2 * dt)
    rate = dt * s * r * (1 - 3 * s * r)
    return np.stack([a * b * s * r * dt * s * r / 3, cross, cross, rate], -1).reshape(-1, 2, 2)


def _moved_covariance(local: Array, by_states: Array, states: Array, bridge: Array) -> Array:
    """Covariance (n, 12, 12) of the pose and twist, of those of the states and of the bridge.

    `by_states` (n, 12, m) is the derivative of the local variables (n, 12) by the states, the pose
    of state i in the first six columns.
    """
    by_local, by_pose_i = np.empty((len(local), 12, 12)), np.empty((len(local), 6, 6))
    _moved_jacobian_batch(local, by_local, by_pose_i)
    moved = by_local @ by_states
    moved[:, :6, :6] += by_pose_i
    covariance = moved @ states @ np.swapaxes(moved, 1, 2)
    covariance += by_local @ bridge @ np.swapaxes(by_local, 1, 2)
    return 0.5 * (covariance + np.swapaxes(covariance, 1, 2))


@kernel
def _moved_jacobian_batch(local: Array, by_local: Array, by_pose_i: Array) -> None:
    for n in range(len(local)):
        copy_kernel(moved_jacobian_kernel(local[n]), by_local[n])
        copy_kernel(backward_adjoint_kernel(local[n]), by_pose_i[n])


def _moved_state(
    T_i: Array, local: Array, covariance: Array | None, batch: tuple[int, ...]
) -> InterpolatedState:
    """The state with the given local variables around T_i, in the shape of the batch."""
    pose, velocity = np.empty((len(local), 4, 4)), np.empty((len(local), 6))
    _moved_batch(T_i, local, pose, velocity)
    if covariance is not None:
        covariance = covariance.reshape(*batch, 12, 12)
    return InterpolatedState(pose.reshape(*batch, 4, 4), velocity.reshape(*batch, 6), covariance)


@kernel
def _moved_batch(T_i: Array, local: Array, T: Array, v: Array) -> None:
    for n in range(len(local)):
        moved_kernel(T_i[n], local[n], T[n], v[n])


def _spread(array: ArrayLike, batch: tuple[int, ...], element: tuple[int, ...]) -> Array:
    """The array with its leading axes broadcast to `batch` and flattened."""
    whole = np.broadcast_to(np.asarray(array, np.float64), (*batch, *element))
    return np.ascontiguousarray(whole).reshape(-1, *element)


def extrapolate(
    T_i: ArrayLike,
    v_i: ArrayLike,
    dt: ArrayLike,
    qc: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> InterpolatedState:
    """State at constant body velocity dt seconds after state i, or before it if dt is negative.

    Parameters
    ----------
    T_i, v_i
        (..., 4, 4) pose T_world_body and (..., 6) body twist.
    dt
        (...) seconds.
    qc
        Power spectral density, (6,) or (6, 6); needed with a covariance.
    covariance
        (..., 12, 12) of T_i and v_i.

    Raises
    ------
    ValueError
        If a covariance is given without qc.
    """
    dt = np.asarray(dt, np.float64)
    batch = np.broadcast_shapes(dt.shape, np.shape(v_i)[:-1])
    T_i, v_i, dt = _spread(T_i, batch, (4, 4)), _spread(v_i, batch, (6,)), _spread(dt, batch, ())
    local = np.concatenate([dt[:, None] * v_i, v_i], axis=1)
    result = None
    if covariance is not None:
        if qc is None:
            raise ValueError("qc is needed to extrapolate a covariance")
        zero, one = np.zeros_like(dt), np.ones_like(dt)
        by_state = kronecker(np.stack([zero, dt, zero, one], -1).reshape(-1, 2, 2), np.eye(6))
        h = abs(dt)
        noise = np.stack([h**3 / 3, h * dt / 2, h * dt / 2, h], -1).reshape(-1, 2, 2)
        start = _spread(covariance, batch, (12, 12))
        noise = kronecker(noise, power_spectral_density(qc))
        result = _moved_covariance(local, by_state, start, noise)
    return _moved_state(T_i, local, result, batch)
