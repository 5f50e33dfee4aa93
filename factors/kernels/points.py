"""Errors axes (T p) - goal of a point p on a body, at a state and between two states.

The m `lines` (m, 4) are an axis of the world each, and the goal along it.
"""

from __future__ import annotations

import numpy as np

from factors.kernels.between import (
    POSE_ONLY,
    between_kernel,
    chain_kernel,
    whiten_between_kernel,
)
from factors.kernels.compiled import inner_kernel, kernel
from factors.kernels.outputs import Addresses, error_at, jacobian_at
from factors.kernels.se3 import Array


@inner_kernel
def _system_kernel(T: Array, p: Array, lines: Array) -> Array:
    """Compute the Jacobian by the pose T, whose first three rows count, and the error, (m, 7)."""
    system = np.empty((7, len(lines))).T
    x, y, z = p[0], p[1], p[2]
    for i in range(len(lines)):
        a, b, c, error = 0.0, 0.0, 0.0, -lines[i, 3]
        for k in range(3):
            a += lines[i, k] * T[k, 0]
            b += lines[i, k] * T[k, 1]
            c += lines[i, k] * T[k, 2]
            error += lines[i, k] * T[k, 3]
        system[i, 0], system[i, 1], system[i, 2] = y * c - z * b, z * a - x * c, x * b - y * a
        system[i, 3], system[i, 4], system[i, 5] = a, b, c
        system[i, 6] = error + a * x + b * y + c * z
    return system


@kernel
def point_kernel(T: Array, p: Array, lines: Array, outputs: Addresses) -> None:
    """Write the error (m,) and its Jacobian (m, 6) by the pose T (4, 4)."""
    m, system = len(lines), _system_kernel(T, p, lines)
    error, by_pose = error_at(outputs, m), jacobian_at(outputs, 0, m, 6)
    for i in range(m):
        error[i] = system[i, 6]
        for j in range(6):
            by_pose[i, j] = system[i, j]


@kernel
def point_between_kernel(
    T_i: Array,
    v_i: Array,
    T_j: Array,
    v_j: Array,
    t: Array,
    p: Array,
    lines: Array,
    noise: Array,
    W: Array,
    outputs: Addresses,
) -> None:
    """Write the error (m,) at the time t[0] after state i, t[1] before j, and its Jacobians (m, 6).

    They are whitened by the covariance `noise` (m, m) of the measurement and that of the state
    between, see `whiten_between_kernel`; not, if it is (0, 0).
    """
    found = np.empty(48)
    between_kernel(T_i, v_i, T_j, v_j, t, found)
    system = _system_kernel(found[6:18].reshape(3, 4), p, lines)
    if len(noise):
        whiten_between_kernel(T_i, v_i, T_j, v_j, t, noise, W, POSE_ONLY, found, system)
    chain_kernel(v_j, t, found, system.T[:6], system.T[:0], outputs)
    error = error_at(outputs, len(lines))
    for i in range(len(lines)):
        error[i] = system[i, 6]
