"""The white-noise-on-acceleration (WNOA) motion prior between two states.

Equations (prior_err) and (prior_cov) of Wang and Gammell; Barfoot, "State Estimation for Robotics",
chapter 11. With T_world_body, right perturbations, rotation first, and xi = Log(T_i^-1 T_j), the
error is e = [xi - dt v_i, Jr(xi)^-1 v_j - v_i].
"""

from __future__ import annotations

from typing import Any, overload

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    Pose,
    checked_duration,
    checked_pose,
    checked_vector,
    power_spectral_density,
)
from factors.factor import Factor
from factors.jacobian_blocks import JacobianBlocks, Jacobians
from factors.kernels import (
    EXACT,
    FIRST_ORDER,
    Array,
    copy_kernel,
    inner_kernel,
    kernel,
    local_blocks_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    row_major_kernel,
)
from factors.variables import POSE3, TWIST, State, Variable, are_states, as_state

_BLOCKS = JacobianBlocks(12, (6, 6, 6, 6))


def whitening(qc: ArrayLike) -> Array:
    """Compute the lower triangular W (6, 6) with WᵀW = qc^-1."""
    return np.linalg.inv(np.linalg.cholesky(power_spectral_density(qc)))


def wnoa_covariance(dt: float, qc: ArrayLike) -> Array:
    """Compute the covariance Q_k (12, 12) of the prior's error after dt, equation (prior_cov)."""
    dt = checked_duration(dt)
    scalars = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return kronecker(scalars, power_spectral_density(qc))


def wnoa_information(dt: float, qc: ArrayLike) -> Array:
    """Compute the inverse (12, 12) of `wnoa_covariance` in closed form."""
    root = wnoa_square_root_information(dt, qc)
    return root.T @ root


def wnoa_square_root_information(dt: float, qc: ArrayLike) -> Array:
    """Compute S (12, 12) with SᵀS = Q_k^-1 in closed form."""
    return kronecker(information_root(checked_duration(dt)), whitening(qc))


def information_root(dt: ArrayLike) -> Array:
    """Compute the scalars (..., 2, 2) whose Kronecker product with the whitening of qc is S."""
    dt = np.asarray(dt, np.float64)
    scalars = [np.sqrt(12 / dt**3), -np.sqrt(3 / dt), np.zeros_like(dt), np.sqrt(1 / dt)]
    return np.stack(scalars, -1).reshape(*dt.shape, 2, 2)


def wnoa_square_root_covariance(dt: float, qc: ArrayLike) -> Array:
    """Compute the lower triangular L (12, 12) with LLᵀ = Q_k in closed form."""
    dt = checked_duration(dt)
    scalars = np.array([[np.sqrt(dt**3 / 3), 0], [np.sqrt(3 * dt) / 2, np.sqrt(dt) / 2]])
    return kronecker(
        scalars, np.asarray(np.linalg.cholesky(power_spectral_density(qc)), np.float64)
    )


def kronecker(scalars: Array, matrix: Array) -> Array:
    """Compute the Kronecker products (..., 12, 12) of scalars (..., 2, 2) and a matrix (6, 6)."""
    return np.einsum("...ij,kl->...ikjl", scalars, matrix).reshape(*scalars.shape[:-2], 12, 12)


@kernel
def wnoa_kernel(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, dt: float, derivatives: bool, higher: float
) -> Array:
    """Compute the Jacobian of the error (12, 24) and, as the last column, the error: (12, 25).

    The Jacobian is with respect to T_i, v_i, T_j, v_j.
    """
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
    T_i: Pose, v_i: ArrayLike, T_j: Pose, v_j: ArrayLike, dt: float
) -> tuple[Array, Array]:
    """Compute the error (12,) of the prior and its exact Jacobian (12, 24).

    The Jacobian is with respect to T_i, v_i, T_j, v_j.
    """
    T_i, T_j = checked_pose("T_i", T_i), checked_pose("T_j", T_j)
    v_i, v_j = checked_vector("v_i", v_i, 6), checked_vector("v_j", v_j, 6)
    result = wnoa_kernel(T_i, v_i, T_j, v_j, checked_duration(dt), True, EXACT)
    return result[:, 24], result[:, :24]


@kernel
def _whitened_kernel(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    constants: Array,
    derivatives: bool,
    error: Array,
    by_T_i: Array,
    by_v_i: Array,
    by_T_j: Array,
    by_v_j: Array,
) -> None:
    """Write the whitened error (12,) and its Jacobians (12, 6) with respect to T_i, v_i, T_j, v_j.

    The error is whitened by the Kronecker product of [[a, b], [0, c]] and a lower triangular W (6,
    6). The constants (42,) are dt, a, b, c, the weight of Jacobians beyond first order, whether W
    is diagonal, and W.
    """
    dt, a, b, c = constants[0], constants[1], constants[2], constants[3]
    higher, diagonal, W = constants[4], constants[5] > 0, constants[6:].reshape(6, 6)
    local = local_state_kernel(row_major_kernel(T_i), row_major_kernel(T_j), v_j)
    for i in range(6):
        top, bottom = 0.0, 0.0
        for k in range(i + 1):
            top += W[i, k] * (local[k] - dt * v_i[k])
            bottom += W[i, k] * (local[6 + k] - v_i[k])
        error[i], error[6 + i] = a * top + b * bottom, c * bottom
    if derivatives:
        xi_i, xi_j, rate_i, rate_j = local_blocks_kernel(local, v_j, higher)
        for block in (xi_i, xi_j, rate_i, rate_j):
            _whiten_kernel(W, diagonal, block)
        for j in range(6):
            for i in range(6):
                by_T_i[i, j] = -a * xi_i[i, j] - b * rate_i[i, j]
                by_T_i[6 + i, j] = -c * rate_i[i, j]
                by_v_i[i, j] = -(a * dt + b) * W[i, j]
                by_v_i[6 + i, j] = -c * W[i, j]
                by_T_j[i, j] = a * xi_j[i, j] + b * rate_j[i, j]
                by_T_j[6 + i, j] = c * rate_j[i, j]
                by_v_j[i, j] = b * xi_j[i, j]
                by_v_j[6 + i, j] = c * xi_j[i, j]


@inner_kernel
def _whiten_kernel(W: Array, diagonal: bool, block: Array) -> None:
    """Replace a matrix (6, 6) by the product of a lower triangular one and it."""
    for i in range(5, -1, -1):
        for j in range(6):
            block[i, j] *= W[i, i]
            if not diagonal:
                for k in range(i):
                    block[i, j] += W[i, k] * block[k, j]


class WnoaFactor(Factor):
    """Motion prior between the states (pose, velocity) at two times that are dt seconds apart.

    It takes either the keys, `WnoaPriorFactor(pose_i, velocity_i, pose_j, velocity_j, dt, qc)`, or
    the states, `WnoaPriorFactor(state_i, state_j, qc)`.

    Parameters
    ----------
    pose_i, velocity_i, pose_j, velocity_j
        Keys of Pose3 T_world_body and of the body twists (6,), rotation first.
    dt
        Seconds from i to j, positive.
    state_i, state_j
        Instead of these: gtsam.StateData, or tuples (pose key, velocity key, seconds).
    qc
        Power spectral density of the white noise on acceleration: diagonal (6,) or (6, 6).
    approximate_jacobians
        Use the paper's first-order E_21 and E_23 instead of the exact Jacobians.

    Notes
    -----
    The error is whitened in the factor and its noise model is Unit, because GTSAM 4.3 turns the
    covariance of short durations into a diagonal one, without correlation of pose and velocity.

    Raises
    ------
    ValueError
        If dt is not positive or qc is not positive definite; and see `Factor`.
    """

    dt: float
    qc: Array

    @overload
    def __init__(
        self,
        pose_i: int,
        velocity_i: int,
        pose_j: int,
        velocity_j: int,
        dt: float,
        qc: ArrayLike,
        approximate_jacobians: bool = False,
    ) -> None: ...

    @overload
    def __init__(
        self, state_i: State, state_j: State, qc: ArrayLike, approximate_jacobians: bool = False
    ) -> None: ...

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        made_of = (_by_states if are_states(args, kwargs) else _by_keys)(*args, **kwargs)
        pose_i, velocity_i, pose_j, velocity_j, dt, qc, approximate_jacobians = made_of.values()
        W, root = whitening(qc), information_root(dt)
        higher = FIRST_ORDER if approximate_jacobians else EXACT
        diagonal = float(np.count_nonzero(W) == 6)
        constants = np.r_[dt, root[0, 0], root[0, 1], root[1, 1], higher, diagonal, W.ravel()]

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            _whitened_kernel(
                values.atPose3(pose_i).matrix(),
                values.atVector6(velocity_i),
                values.atPose3(pose_j).matrix(),
                values.atVector6(velocity_j),
                constants,
                jacobians is not None,
                *_BLOCKS.outputs,
            )
            if jacobians is not None:
                _BLOCKS.copy_to(jacobians)
            return _BLOCKS.error

        variables = [
            Variable("pose_i", pose_i, POSE3),
            Variable("velocity_i", velocity_i, TWIST),
            Variable("pose_j", pose_j, POSE3),
            Variable("velocity_j", velocity_j, TWIST),
        ]
        super().__init__(gtsam.noiseModel.Unit.Create(12), variables, error, made_of)


def _by_keys(
    pose_i: int,
    velocity_i: int,
    pose_j: int,
    velocity_j: int,
    dt: float,
    qc: ArrayLike,
    approximate_jacobians: bool = False,
) -> dict[str, Any]:
    """Check and name the arguments of a prior between keys."""
    return {
        "pose_i": int(pose_i),
        "velocity_i": int(velocity_i),
        "pose_j": int(pose_j),
        "velocity_j": int(velocity_j),
        "dt": checked_duration(dt),
        "qc": np.array(qc, np.float64),
        "approximate_jacobians": bool(approximate_jacobians),
    }


def _by_states(
    state_i: State, state_j: State, qc: ArrayLike, approximate_jacobians: bool = False
) -> dict[str, Any]:
    """Check and name the arguments of a prior between states."""
    pose_i, velocity_i, t_i = as_state("state_i", state_i)
    pose_j, velocity_j, t_j = as_state("state_j", state_j)
    if not t_i < t_j:
        raise ValueError(f"state_j must be later than state_i: dt = {t_j - t_i} s")
    keys = pose_i, velocity_i, pose_j, velocity_j
    return _by_keys(*keys, t_j - t_i, qc, approximate_jacobians)
