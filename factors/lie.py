"""SE(3) in closed form, exact from zero to pi: exponential, logarithm, adjoints, Jacobians.

Twists are (rotation, translation), shape (..., 6); transforms are (..., 4, 4), or gtsam.Pose3;
leading axes are batches. Barfoot, "State Estimation for Robotics", chapter 7, with the halves of a
twist swapped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from factors.checks import Poses, checked_array, checked_poses
from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_kernel
from factors.kernels.se3 import (
    LEFT,
    Array,
    exp_kernel,
    inverse_coefficients_kernel,
    jacobian_coefficients_kernel,
    log_kernel,
    se3_polynomial_kernel,
)


def skew(a: ArrayLike) -> Array:
    """Compute the matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    a = checked_array("a", a, (3,))
    matrix = np.zeros((*a.shape, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        matrix[..., k, j], matrix[..., j, k] = a[..., i], -a[..., i]
    return matrix


def se3_exp(xi: ArrayLike) -> Array:
    """Compute the transforms (..., 4, 4) of twists (..., 6)."""
    twists = checked_array("xi", xi, (6,))
    transforms = np.empty((*twists.shape[:-1], 4, 4))
    _exp_batch(twists.reshape(-1, 6), transforms.reshape(-1, 4, 4))
    return transforms


@kernel
def _exp_batch(twists: Array, transforms: Array) -> None:
    for n in range(len(twists)):
        copy_kernel(exp_kernel(twists[n]), transforms[n])


def se3_log(T: Poses) -> Array:
    """Compute the twists (..., 6) of transforms (..., 4, 4), rotation angle at most pi."""
    transforms = checked_poses("T", T)
    twists = np.empty((*transforms.shape[:-2], 6))
    _log_batch(transforms.reshape(-1, 4, 4), twists.reshape(-1, 6))
    return twists


@kernel
def _log_batch(transforms: Array, twists: Array) -> None:
    for n in range(len(twists)):
        xi = log_kernel(transforms[n])
        for i in range(6):
            twists[n, i] = xi[i]


def se3_inverse(T: Poses) -> Array:
    """Invert transforms (..., 4, 4)."""
    T = checked_poses("T", T)
    inverse = np.zeros_like(T)
    inverse[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
    inverse[..., :3, 3:] = -inverse[..., :3, :3] @ T[..., :3, 3:]
    inverse[..., 3, 3] = 1.0
    return inverse


def se3_adjoint(T: Poses) -> Array:
    """Compute the adjoints (..., 6, 6) of transforms (..., 4, 4)."""
    T = checked_poses("T", T)
    rotation = T[..., :3, :3]
    return _lower_triangular(rotation, skew(T[..., :3, 3]) @ rotation)


def se3_curly(xi: ArrayLike) -> Array:
    """Compute the small adjoints (..., 6, 6) of twists (..., 6)."""
    xi = checked_array("xi", xi, (6,))
    return _lower_triangular(skew(xi[..., :3]), skew(xi[..., 3:]))


def _lower_triangular(diagonal: Array, below: Array) -> Array:
    """Assemble matrices [[diagonal, 0], [below, diagonal]] (..., 6, 6) of blocks (..., 3, 3)."""
    matrix = np.zeros((*diagonal.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = diagonal
    matrix[..., 3:, :3] = below
    return matrix


def se3_left_jacobian(xi: ArrayLike) -> Array:
    """Compute left Jacobians J (..., 6, 6) of twists (..., 6): Exp(xi + d) = Exp(J d) Exp(xi)."""
    return _left_jacobian(xi, False)


def se3_right_jacobian(xi: ArrayLike) -> Array:
    """Compute right Jacobians J (..., 6, 6) of twists (..., 6): Exp(xi + d) = Exp(xi) Exp(J d)."""
    return _left_jacobian(-checked_array("xi", xi, (6,)), False)


def se3_left_jacobian_inverse(xi: ArrayLike) -> Array:
    """Compute inverse left Jacobians (..., 6, 6) of twists (..., 6); singular at angle 2 pi."""
    return _left_jacobian(xi, True)


def se3_right_jacobian_inverse(xi: ArrayLike) -> Array:
    """Compute inverse right Jacobians (..., 6, 6) of twists (..., 6); singular at angle 2 pi."""
    return _left_jacobian(-checked_array("xi", xi, (6,)), True)


def _left_jacobian(xi: ArrayLike, inverse: bool) -> Array:
    twists = checked_array("xi", xi, (6,))
    jacobians = np.empty((*twists.shape, 6))
    _left_jacobian_batch(twists.reshape(-1, 6), inverse, jacobians.reshape(-1, 6, 6))
    return jacobians


@kernel
def _left_jacobian_batch(twists: Array, inverse: bool, jacobians: Array) -> None:
    for n in range(len(twists)):
        k = jacobian_coefficients_kernel(twists[n], LEFT)
        if inverse:
            k = inverse_coefficients_kernel(twists[n], LEFT)
        copy_kernel(se3_polynomial_kernel(twists[n], k), jacobians[n])
