"""The white-noise-on-acceleration (WNOA) motion prior between two states.

Equations (prior_err) and (prior_cov) of Wang and Gammell; Barfoot, "State Estimation for Robotics",
chapter 11. With T_world_body, right perturbations, rotation first, and xi = Log(T_i^-1 T_j), the
error is e = [xi - dt v_i, Jr(xi)^-1 v_j - v_i].
"""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_duration, power_spectral_density
from factors.kernels import Array, copy_kernel, kernel
from factors.local import EXACT, FIRST_ORDER, local_jacobian_kernel, local_state_kernel
from factors.values import STATE_COLUMNS, pose_matrix


def whitening(qc: ArrayLike) -> Array:
    """(6, 6) lower triangular W with WᵀW = qc^-1."""
    return np.linalg.inv(np.linalg.cholesky(power_spectral_density(qc)))


def wnoa_covariance(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) covariance Q_k of the prior's error after dt seconds, equation (prior_cov)."""
    dt = checked_duration(dt)
    scalars = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return kronecker(scalars, power_spectral_density(qc))


def wnoa_information(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) inverse of `wnoa_covariance`, in closed form."""
    root = wnoa_square_root_information(dt, qc)
    return root.T @ root


def wnoa_square_root_information(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) S with SᵀS = Q_k^-1, in closed form."""
    dt = checked_duration(dt)
    scalars = np.array([[np.sqrt(12 / dt**3), -np.sqrt(3 / dt)], [0, np.sqrt(1 / dt)]])
    return kronecker(scalars, whitening(qc))


def wnoa_square_root_covariance(dt: float, qc: ArrayLike) -> Array:
    """(12, 12) lower triangular L with LLᵀ = Q_k, in closed form."""
    dt = checked_duration(dt)
    scalars = np.array([[np.sqrt(dt**3 / 3), 0], [np.sqrt(3 * dt) / 2, np.sqrt(dt) / 2]])
    return kronecker(
        scalars, np.asarray(np.linalg.cholesky(power_spectral_density(qc)), np.float64)
    )


def kronecker(scalars: Array, matrix: Array) -> Array:
    """Kronecker products (..., 12, 12) of scalars (..., 2, 2) and one matrix (6, 6)."""
    return np.einsum("...ij,kl->...ikjl", scalars, matrix).reshape(*scalars.shape[:-2], 12, 12)


@kernel
def wnoa_kernel(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, dt: float, derivatives: bool, higher: float
) -> Array:
    """(12, 25) derivative of the error by T_i, v_i, T_j, v_j, then the error itself."""
    local = local_state_kernel(T_i, T_j, v_j)
    result = np.zeros((12, 25))
    if derivatives:
        copy_kernel(local_jacobian_kernel(local, v_j, higher), result)
    for i in range(6):
        result[i, 24] = local[i] - dt * v_i[i]
        result[6 + i, 24] = local[6 + i] - v_i[i]
        result[i, 6 + i] = -dt
        result[6 + i, 6 + i] = -1.0
    return result


def wnoa_error(
    T_i: ArrayLike, v_i: ArrayLike, T_j: ArrayLike, v_j: ArrayLike, dt: float
) -> tuple[Array, Array]:
    """Error (12,) of the prior and its exact Jacobian (12, 24) by T_i, v_i, T_j, v_j."""
    T_i, v_i, T_j, v_j = (np.ascontiguousarray(x, np.float64) for x in (T_i, v_i, T_j, v_j))
    dt = checked_duration(dt)
    result = wnoa_kernel(T_i, v_i, T_j, v_j, dt, True, EXACT)
    return result[:, 24], result[:, :24]


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
    dt, S = checked_duration(dt), wnoa_square_root_information(dt, qc)
    higher = FIRST_ORDER if approximate_jacobians else EXACT

    def error(
        _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        derivatives = wnoa_kernel(
            pose_matrix(values, pose_i),
            values.atVector(velocity_i),
            pose_matrix(values, pose_j),
            values.atVector(velocity_j),
            dt,
            jacobians is not None,
            higher,
        )
        result = S.dot(derivatives)
        if jacobians is not None:
            for block, columns in enumerate(STATE_COLUMNS):
                jacobians[block] = result[columns]
        return result[:, 24]

    keys = [pose_i, velocity_i, pose_j, velocity_j]
    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(12), keys, error)
