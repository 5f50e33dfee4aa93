"""Covariances of motion priors, and the error of the one of white noise on acceleration (WNOA).

Equations (prior_err) and (prior_cov) of Wang and Gammell; Barfoot, "State Estimation for Robotics",
chapter 11. With T_world_body, right perturbations, rotation first, and xi = Log(T_i^-1 T_j), the
error is e = [xi - dt v_i, Jr(xi)^-1 v_j - v_i].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    Pose,
    checked_duration,
    checked_pose,
    checked_vector,
    power_spectral_density,
)
from factors.kernels.local_variables import wnoa_kernel
from factors.kernels.se3 import Array


def halfway_duration(qc: float, deviation: float) -> float:
    """Return the seconds between two states after which one half-way is as uncertain, given both.

    Its variance by the prior is qc dt^3 / 192.
    """
    return float(np.cbrt(192 * deviation**2 / max(qc, np.finfo(float).tiny)))


def whitening(qc: ArrayLike, dimension: int = 6) -> Array:
    """Compute the lower triangular W (n, n) with WᵀW = qc^-1."""
    matrix = power_spectral_density(qc, dimension)
    if np.ndim(qc) == 1:
        return np.diag(1 / np.sqrt(matrix.diagonal()))
    return np.linalg.inv(np.linalg.cholesky(matrix))


def information_root(dt: ArrayLike, order: int = 2) -> Array:
    """Compute the upper triangular scalars (..., order, order) whose Kronecker product with W is S.

    W is the `whitening` of qc, and S that of the prior's error after dt (...) seconds.
    """
    dt = np.asarray(dt, np.float64)[..., None, None]
    powers = dt ** (0.5 - np.arange(order, 0, -1))
    five, three = np.sqrt(5), np.sqrt(3)
    if order == 2:
        return np.array([[2 * three, -three], [0, 1]]) * powers
    return np.array([[12 * five, -6 * five, five], [0, 2 * three, -three], [0, 0, 1]]) * powers


def prior_square_root_information(
    order: int, dt: float, qc: ArrayLike, dimension: int = 6
) -> Array:
    """Compute S (order n, order n) with SᵀS the inverse of `prior_covariance`, in closed form."""
    return kronecker(_root(order, dt), whitening(qc, dimension))


def prior_covariance(order: int, dt: float, qc: ArrayLike, dimension: int = 6) -> Array:
    """Compute the covariance (order n, order n) of a prior's error after dt seconds.

    `order` is 2 for WNOA and 3 for WNOJ; `qc` the power spectral density, (n,) or (n, n), of the
    white noise, with n = `dimension`.

    Raises
    ------
    ValueError
        If the order is another one, dt is not positive or qc is not positive definite.
    """
    root = np.linalg.inv(_root(order, dt))
    return kronecker(root @ root.T, power_spectral_density(qc, dimension))


def _root(order: int, dt: float) -> Array:
    """Compute the `information_root` of one checked duration."""
    if order not in (2, 3):
        raise ValueError(f"order must be 2, of WNOA, or 3, of WNOJ, not {order}")
    return information_root(checked_duration(dt), order)


def wnoa_covariance(dt: float, qc: ArrayLike) -> Array:
    """Compute the covariance Q_k (12, 12) of the prior's error after dt, equation (prior_cov)."""
    return prior_covariance(2, dt, qc)


def wnoa_information(dt: float, qc: ArrayLike) -> Array:
    """Compute the inverse (12, 12) of `wnoa_covariance` in closed form."""
    root = wnoa_square_root_information(dt, qc)
    return root.T @ root


def wnoa_square_root_information(dt: float, qc: ArrayLike) -> Array:
    """Compute S (12, 12) with SᵀS = Q_k^-1 in closed form."""
    return prior_square_root_information(2, dt, qc)


def wnoa_square_root_covariance(dt: float, qc: ArrayLike) -> Array:
    """Compute the lower triangular L (12, 12) with LLᵀ = Q_k in closed form."""
    dt = checked_duration(dt)
    scalars = np.array([[np.sqrt(dt**3 / 3), 0], [np.sqrt(3 * dt) / 2, np.sqrt(dt) / 2]])
    root = np.asarray(np.linalg.cholesky(power_spectral_density(qc)), np.float64)
    return kronecker(scalars, root)


def kronecker(scalars: Array, matrix: Array) -> Array:
    """Compute the Kronecker products (..., m n, m n) of scalars (..., m, m) and a matrix (n, n)."""
    size = scalars.shape[-1] * len(matrix)
    product = np.einsum("...ij,kl->...ikjl", scalars, matrix)
    return np.asarray(product.reshape(*scalars.shape[:-2], size, size), np.float64)


def wnoa_error(
    T_i: Pose, v_i: ArrayLike, T_j: Pose, v_j: ArrayLike, dt: float
) -> tuple[Array, Array]:
    """Compute the error (12,) of the prior and its exact Jacobian (12, 24).

    The Jacobian is with respect to T_i, v_i, T_j, v_j.
    """
    T_i, T_j = checked_pose("T_i", T_i), checked_pose("T_j", T_j)
    v_i, v_j = checked_vector("v_i", v_i, 6), checked_vector("v_j", v_j, 6)
    result = wnoa_kernel(T_i, v_i, T_j, v_j, checked_duration(dt))
    return result[:, 24], result[:, :24]
