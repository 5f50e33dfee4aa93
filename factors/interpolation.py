"""Pose, velocity and covariance between and beyond states, by the WNOA Gaussian process.

Section III-C.2 of Wang and Gammell; Barfoot, "State Estimation for Robotics", chapter 11. Around
state i the local variables are xi(t) = Log(T_i^-1 T(t)) and its rate w = Jr(xi)^-1 v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from factors.lie import (
    adjoint_kernel,
    exp_kernel,
    inverse_kernel,
    left_jacobian_inverse_kernel,
    log_kernel,
    right_jacobian_inverse_kernel,
    right_jacobian_kernel,
    right_jacobian_product_derivative_kernel,
)
from factors.wnoa import power_spectral_density

Array = NDArray[np.float64]


class InterpolatedState(NamedTuple):
    """Pose (..., 4, 4), body twist (..., 6) and their covariance (..., 12, 12) if it was asked for.

    The covariance is that of a right perturbation of the pose, rotation first, and of the twist.
    """

    pose: Array
    velocity: Array
    covariance: Array | None


@njit(cache=True)
def hermite_weights(a: float, b: float) -> Array:
    """(2, 2, 2) scalar weights of (xi, w) at the time a after state i and b before state j.

    The first is Lambda, the weight of state i's local variables, the second Omega, of state j's.
    """
    dt = a + b
    s = a / dt
    weights = np.empty((2, 2, 2))
    weights[1, 0, 0], weights[1, 0, 1] = s * s * (3 - 2 * s), -s * s * b
    weights[1, 1, 0], weights[1, 1, 1] = 6 * s * (1 - s) / dt, s * (3 * s - 2)
    weights[0, 0, 0], weights[0, 0, 1] = (1 - s) ** 2 * (1 + 2 * s), (1 - s) ** 2 * a
    weights[0, 1, 0], weights[0, 1, 1] = -weights[1, 1, 0], (1 - s) * (1 - 3 * s)
    return weights


@njit(cache=True)
def bridge_covariance(a: float, b: float) -> Array:
    """(2, 2) covariance of (xi, w) given both states, per unit of power spectral density."""
    dt = a + b
    cross = (a * b) ** 2 * (b - a) / (2 * dt**3)
    rate = a * b * (a * a - a * b + b * b) / dt**3
    return np.array([[(a * b) ** 3 / (3 * dt**3), cross], [cross, rate]])


@njit(cache=True)
def interpolate_kernel(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: float, b: float
) -> tuple[Array, Array]:
    """Pose (4, 4) and twist (6,) at a seconds after state i and b seconds before state j."""
    xi_j = log_kernel(inverse_kernel(T_i) @ T_j)
    w_j = right_jacobian_inverse_kernel(xi_j) @ v_j
    of_i, of_j = hermite_weights(a, b)
    xi = of_i[0, 1] * v_i + of_j[0, 0] * xi_j + of_j[0, 1] * w_j
    w = of_i[1, 1] * v_i + of_j[1, 0] * xi_j + of_j[1, 1] * w_j
    return T_i @ exp_kernel(xi), right_jacobian_kernel(xi) @ w


@njit(cache=True)
def interpolation_jacobian_kernel(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: float, b: float
) -> tuple[Array, Array]:
    """Derivatives of the interpolated pose and twist.

    The first (12, 24) is by T_i, v_i, T_j, v_j, the second (12, 12) by the local (xi, w).
    """
    xi_j = log_kernel(inverse_kernel(T_i) @ T_j)
    right_inverse = right_jacobian_inverse_kernel(xi_j)
    w_j = right_inverse @ v_j
    of_i, of_j = hermite_weights(a, b)
    xi = of_i[0, 1] * v_i + of_j[0, 0] * xi_j + of_j[0, 1] * w_j
    w = of_i[1, 1] * v_i + of_j[1, 0] * xi_j + of_j[1, 1] * w_j

    by_local = np.zeros((12, 12))
    by_local[:6, :6] = right_jacobian_kernel(xi)
    by_local[6:, 6:] = by_local[:6, :6]
    by_local[6:, :6] = right_jacobian_product_derivative_kernel(xi, w)

    xi_j_by_pose_i = -left_jacobian_inverse_kernel(xi_j)
    w_j_by_xi_j = -right_inverse @ right_jacobian_product_derivative_kernel(xi_j, w_j)
    local = np.zeros((12, 24))  # derivatives of (xi, w) by the states
    for k in range(2):
        rows = slice(6 * k, 6 * k + 6)
        by_xi_j = of_j[k, 0] * np.eye(6) + of_j[k, 1] * w_j_by_xi_j
        local[rows, :6] = by_xi_j @ xi_j_by_pose_i
        local[rows, 6:12] = of_i[k, 1] * np.eye(6)
        local[rows, 12:18] = by_xi_j @ right_inverse
        local[rows, 18:] = of_j[k, 1] * right_inverse
    by_states = by_local @ local
    by_states[:6, :6] += adjoint_kernel(exp_kernel(-xi))
    return by_states, by_local


@njit(cache=True)
def _interpolated_covariance(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: float, b: float, qc: Array, joint: Array
) -> Array:
    by_states, by_local = interpolation_jacobian_kernel(T_i, v_i, T_j, v_j, a, b)
    bridge = np.zeros((12, 12))
    scalar = bridge_covariance(a, b)
    for i in range(2):
        for j in range(2):
            bridge[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] = scalar[i, j] * qc
    covariance = by_states @ joint @ by_states.T + by_local @ bridge @ by_local.T
    return 0.5 * (covariance + covariance.T)


@njit(cache=True)
def _interpolate_batch(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: Array, b: Array, T: Array, v: Array
) -> None:
    for n in range(len(a)):
        T[n], v[n] = interpolate_kernel(T_i[n], v_i[n], T_j[n], v_j[n], a[n], b[n])


@njit(cache=True)
def _covariance_batch(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    a: Array,
    b: Array,
    qc: Array,
    joint: Array,
    covariance: Array,
) -> None:
    for n in range(len(a)):
        covariance[n] = _interpolated_covariance(
            T_i[n], v_i[n], T_j[n], v_j[n], a[n], b[n], qc, joint[n]
        )


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
    states = (
        _spread(T_i, batch, (4, 4)),
        _spread(v_i, batch, (6,)),
        _spread(T_j, batch, (4, 4)),
        _spread(v_j, batch, (6,)),
        _spread(t - t_i, batch, ()),
        _spread(t_j - t, batch, ()),
    )
    count = len(states[0])
    pose, velocity = np.empty((count, 4, 4)), np.empty((count, 6))
    _interpolate_batch(*states, pose, velocity)
    covariance = None
    if joint_covariance is not None:
        if qc is None:
            raise ValueError("qc is needed to interpolate a covariance")
        joint = _spread(joint_covariance, batch, (24, 24))
        covariance = np.empty((count, 12, 12))
        _covariance_batch(*states, power_spectral_density(qc), joint, covariance)
        covariance = covariance.reshape(*batch, 12, 12)
    return InterpolatedState(pose.reshape(*batch, 4, 4), velocity.reshape(*batch, 6), covariance)


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
    T, v = _spread(T_i, batch, (4, 4)), _spread(v_i, batch, (6,))
    duration = _spread(dt, batch, ())
    pose = np.empty_like(T)
    _extrapolate_batch(T, v, duration, pose)
    result = None
    if covariance is not None:
        if qc is None:
            raise ValueError("qc is needed to extrapolate a covariance")
        start = _spread(covariance, batch, (12, 12))
        result = np.empty_like(start)
        _extrapolated_covariance_batch(v, duration, power_spectral_density(qc), start, result)
        result = result.reshape(*batch, 12, 12)
    return InterpolatedState(pose.reshape(*batch, 4, 4), v.reshape(*batch, 6), result)


@njit(cache=True)
def _extrapolate_batch(T: Array, v: Array, dt: Array, pose: Array) -> None:
    for n in range(len(dt)):
        pose[n] = T[n] @ exp_kernel(dt[n] * v[n])


@njit(cache=True)
def _extrapolated_covariance_batch(
    v: Array, dt: Array, qc: Array, start: Array, result: Array
) -> None:
    """Locally xi = dt w and w = v, then both as `interpolation_jacobian_kernel` maps them."""
    for n in range(len(dt)):
        h, xi = dt[n], dt[n] * v[n]
        by_local = np.zeros((12, 12))
        by_local[:6, :6] = right_jacobian_kernel(xi)
        by_local[6:, 6:] = by_local[:6, :6]
        by_local[6:, :6] = right_jacobian_product_derivative_kernel(xi, v[n])
        local = np.zeros((12, 12))
        local[:6, 6:] = h * np.eye(6)
        local[6:, 6:] = np.eye(6)
        by_state = by_local @ local
        by_state[:6, :6] += adjoint_kernel(exp_kernel(-xi))
        noise = np.zeros((12, 12))
        noise[:6, :6], noise[6:, 6:] = abs(h) ** 3 / 3 * qc, abs(h) * qc
        noise[:6, 6:] = noise[6:, :6] = h * abs(h) / 2 * qc
        covariance = by_state @ start[n] @ by_state.T + by_local @ noise @ by_local.T
        result[n] = 0.5 * (covariance + covariance.T)
