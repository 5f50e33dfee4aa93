"""Poses and twists between neighbouring states, from their local variables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.between import interpolated_jacobian_kernel, state_by_local_kernel
from factors.kernels.compiled import inner_kernel, kernel
from factors.kernels.local_variables import (
    backward_adjoint_kernel,
    hermite_weights,
    interpolated_local_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    retract_kernel,
    write_hermite_weights,
    write_interpolated_local,
)
from factors.kernels.matrices import copy_kernel, copy_vector_kernel
from factors.kernels.se3 import Array, compose_exp_kernel

Index = NDArray[np.int64]


@inner_kernel
def next_states_kernel(T_states: Array, v_states: Array) -> Array:
    """Compute the local variables (n - 1, 12) of each of n states around the one before it."""
    local_j = np.empty((len(T_states) - 1, 12))
    for i in range(len(local_j)):
        next_local = local_state_kernel(T_states[i], T_states[i + 1], v_states[i + 1])
        copy_vector_kernel(next_local, local_j[i])
    return local_j


@kernel
def poses_between_kernel(
    T_states: Array, v_states: Array, first: Index, a: Array, b: Array, count: int
) -> Array:
    """Compute poses (n, 4, 4) at a (n,) seconds after the state `first` (n,), b before the next.

    Those beyond the first `count` states are left zero.
    """
    local_j = next_states_kernel(T_states, v_states)
    share, local = np.empty((2, 2, 2)), np.empty(12)
    T = np.zeros((len(a), 4, 4))
    for n in range(len(a)):
        i = first[n]
        if i + 1 < count:
            write_hermite_weights(a[n], b[n], share)
            write_interpolated_local(v_states[i], local_j[i], share, local)
            compose_exp_kernel(T_states[i], local, T[n])
    return T


@kernel
def states_between_kernel(
    T_states: Array,
    v_states: Array,
    first: Index,
    a: Array,
    b: Array,
    deviation: Array,
    T: Array,
    v: Array,
) -> None:
    """Write poses (n, 4, 4) and twists (n, 6) at a (n,) seconds after the state first (n,).

    The next state is b (n,) seconds later. They deviate by (n, 12) in local variables around the
    first state from the interpolation.
    """
    local_j = next_states_kernel(T_states, v_states)
    share, local = np.empty((2, 2, 2)), np.empty(12)
    for n in range(len(a)):
        i = first[n]
        write_hermite_weights(a[n], b[n], share)
        write_interpolated_local(v_states[i], local_j[i], share, local)
        for m in range(12):
            local[m] += deviation[n, m]
        retract_kernel(T_states[i], local, T[n], v[n])


@kernel
def state_rows_kernel(
    T_i: Array, v_i: Array, T_j: Array, v_j: Array, a: Array, b: Array, deviation: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Poses (n, 4, 4) and twists (n, 6) at times a (n,) after state i and b before state j.

    They deviate by (n, 12) in local variables from the interpolation. Also the derivatives of the
    pose, perturbed on the right, and of the twist: by the local variables (n, 12, 12) and by the
    pose i with these fixed (n, 6, 6); and those of the local variables by both states (n, 12, 24).
    """
    count = len(a)
    T, v, by_local = np.zeros((count, 4, 4)), np.zeros((count, 6)), np.zeros((count, 12, 12))
    by_pose_i, by_states = np.zeros((count, 6, 6)), np.zeros((count, 12, 24))
    local_j = local_state_kernel(T_i, T_j, v_j)
    by_states_j = local_jacobian_kernel(local_j, v_j)
    for n in range(count):
        share = hermite_weights(a[n], b[n])
        local = interpolated_local_kernel(v_i, local_j, share) + deviation[n]
        retract_kernel(T_i, local, T[n], v[n])
        copy_kernel(state_by_local_kernel(local), by_local[n])
        copy_kernel(backward_adjoint_kernel(local), by_pose_i[n])
        copy_kernel(interpolated_jacobian_kernel(by_states_j, share), by_states[n])
    return T, v, by_local, by_pose_i, by_states
