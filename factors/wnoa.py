"""The white-noise-on-acceleration (WNOA) motion prior between two states.

Equations (prior_err) and (prior_cov) of Wang and Gammell; Barfoot, "State Estimation for Robotics",
chapter 11. In this package's convention (T_world_body, right perturbations, rotation first) and with
xi = Log(T_i^-1 T_j) the error is e = [xi - dt v_i, Jr(xi)^-1 v_j - v_i].
"""

from __future__ import annotations

import gtsam
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from factors.lie import (
    curly_kernel,
    inverse_kernel,
    left_jacobian_inverse_kernel,
    log_kernel,
    right_jacobian_inverse_kernel,
    right_jacobian_product_derivative_kernel,
)

Array = NDArray[np.float64]


def power_spectral_density(qc: ArrayLike) -> Array:
    """(6, 6) matrix of a power spectral density given as its diagonal (6,) or whole, checked.

    Raises
    ------
    ValueError
        If the shape is another one, or the matrix is not symmetric and positive definite.
    """
    array = np.asarray(qc, np.float64)
    matrix = np.diag(array) if array.shape == (6,) else array
    if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
        raise ValueError(f"qc must be 6 or 6 x 6 finite numbers, not shape {array.shape}")
    if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix)[0] <= 0:
        raise ValueError("qc must be symmetric and positive definite")
    return matrix


def whitening(qc: ArrayLike) -> Array:
    """(6, 6) lower triangular W with WᵀW = qc^-1."""
    return np.linalg.inv(np.linalg.cholesky(power_spectral_density(qc)))


def checked_duration(dt: float) -> float:
    """The duration itself, if it is finite and positive; ValueError otherwise."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt must be positive seconds, not {dt}")
    return float(dt)


def wnoa_covariance(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) covariance Q_k of the prior's error after dt seconds, equation (prior_cov)."""
    dt = checked_duration(dt)
    return np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], power_spectral_density(qc))


def wnoa_information(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) inverse of `wnoa_covariance`, in closed form."""
    root = wnoa_square_root_information(dt, qc)
    return root.T @ root


def wnoa_square_root_information(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) S with SᵀS = Q_k^-1, in closed form."""
    dt = checked_duration(dt)
    return np.kron([[np.sqrt(12 / dt**3), -np.sqrt(3 / dt)], [0, np.sqrt(1 / dt)]], whitening(qc))


@njit(cache=True)
def wnoa_error_kernel(T_i: Array, v_i: Array, T_j: Array, v_j: Array, dt: float) -> Array:
    """(12,) error of the prior."""
    xi = log_kernel(inverse_kernel(T_i) @ T_j)
    error = np.empty(12)
    error[:6] = xi - dt * v_i
    error[6:] = right_jacobian_inverse_kernel(xi) @ v_j - v_i
    return error


@njit(cache=True)
def wnoa_jacobian_kernel(T_i: Array, T_j: Array, v_j: Array, dt: float, approximate: bool) -> Array:
    """(12, 24) derivative of the error by T_i, v_i, T_j, v_j.

    `approximate` gives the paper's first-order E_21 and E_23.
    """
    xi = log_kernel(inverse_kernel(T_i) @ T_j)
    right_inverse = right_jacobian_inverse_kernel(xi)
    local_velocity = right_inverse @ v_j
    # From Jr(xi) w = v_j: Jr dw + d(Jr w)/dxi dxi = dv_j.
    if approximate:
        by_xi = -0.5 * curly_kernel(v_j)
    else:
        by_xi = -right_inverse @ right_jacobian_product_derivative_kernel(xi, local_velocity)
    jacobian = np.zeros((12, 24))
    jacobian[:6, :6] = -left_jacobian_inverse_kernel(xi)
    jacobian[:6, 12:18] = right_inverse
    jacobian[6:, :6] = by_xi @ np.ascontiguousarray(jacobian[:6, :6])
    jacobian[6:, 12:18] = by_xi @ right_inverse
    jacobian[6:, 18:] = right_inverse
    for k in range(6):
        jacobian[k, 6 + k] = -dt
        jacobian[6 + k, 6 + k] = -1.0
    return jacobian


@njit(cache=True)
def whitened_kernel(rows: Array, dt: float, W: Array) -> Array:
    """S rows (12, n) for the square root information S of `wnoa_square_root_information`."""
    result = np.empty_like(rows)
    upper, lower = W @ rows[:6], W @ rows[6:]
    result[:6] = np.sqrt(12 / dt**3) * upper - np.sqrt(3 / dt) * lower
    result[6:] = np.sqrt(1 / dt) * lower
    return result


@njit(cache=True)
def _whitened_error(T_i: Array, v_i: Array, T_j: Array, v_j: Array, dt: float, W: Array) -> Array:
    error = wnoa_error_kernel(T_i, v_i, T_j, v_j, dt)
    return whitened_kernel(error.reshape(12, 1), dt, W)[:, 0]


@njit(cache=True)
def _whitened_jacobian(
    T_i: Array, T_j: Array, v_j: Array, dt: float, W: Array, approximate: bool
) -> Array:
    return whitened_kernel(wnoa_jacobian_kernel(T_i, T_j, v_j, dt, approximate), dt, W)


def wnoa_error(
    T_i: ArrayLike, v_i: ArrayLike, T_j: ArrayLike, v_j: ArrayLike, dt: float
) -> tuple[Array, Array]:
    """Error (12,) of the prior and its exact Jacobian (12, 24) by T_i, v_i, T_j, v_j."""
    T_i, v_i, T_j, v_j = (np.ascontiguousarray(x, np.float64) for x in (T_i, v_i, T_j, v_j))
    dt = checked_duration(dt)
    error = wnoa_error_kernel(T_i, v_i, T_j, v_j, dt)
    return error, wnoa_jacobian_kernel(T_i, T_j, v_j, dt, False)


def WnoaPriorFactor(
    pose_i: int,
    velocity_i: int,
    pose_j: int,
    velocity_j: int,
    dt: float,
    qc: ArrayLike,
    approximate_jacobians: bool = False,
) -> gtsam.CustomFactor:
    """Motion prior between the states (pose, velocity) at two times that are dt seconds apart.

    Parameters
    ----------
    pose_i, velocity_i, pose_j, velocity_j
        Keys of Pose3 T_world_body and of the body twists (6,), rotation first.
    dt
        Seconds from i to j, positive.
    qc
        Power spectral density of the white noise on acceleration: diagonal (6,) or (6, 6).
    approximate_jacobians
        Use the paper's first-order E_21 and E_23 instead of the exact derivatives.

    Notes
    -----
    The error is whitened in the factor, its noise model is Unit: GTSAM 4.3 turns the covariance of
    short durations into a diagonal one and loses the correlation of pose and velocity.

    Raises
    ------
    ValueError
        If dt is not positive or qc not positive definite.
    """
    W, dt = whitening(qc), checked_duration(dt)

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        T_i, T_j = values.atPose3(pose_i).matrix(), values.atPose3(pose_j).matrix()
        v_i, v_j = values.atVector(velocity_i), values.atVector(velocity_j)
        if jacobians is not None:
            whole = _whitened_jacobian(T_i, T_j, v_j, dt, W, approximate_jacobians)
            for block in range(4):
                jacobians[block] = whole[:, 6 * block : 6 * block + 6]
        return _whitened_error(T_i, v_i, T_j, v_j, dt, W)

    keys = [pose_i, velocity_i, pose_j, velocity_j]
    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(12), keys, error)
