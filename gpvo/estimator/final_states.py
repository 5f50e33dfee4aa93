"""Final states of consecutive windows, joined where they meet.

A window moves the state that it starts with from where the window before it had it, and the states
before that one are no longer in it. The Gaussian process says how they move along: given the states
at both ends of a piece, the mean of those between follows by interpolation. Section III-C.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from factors.kernels.local_variables import hermite_weights, local_state_kernel, retract_kernel
from factors.kernels.se3 import copy_kernel, copy_vector_kernel
from gpvo.trajectory.states import States

Array = NDArray[np.float64]


def correct_final_states(piece: States, end: States) -> States:
    """States (K,), the first as it is and the last one moved to a state (1,) at the same time.

    Those between move by the correction's interpolation in the local variables around the first.
    """
    T, twist = piece.T_world_cam.copy(), piece.twist.copy()
    _correct_kernel(piece.t, T, twist, end.T_world_cam[0], end.twist[0])
    return States(piece.t, T, twist)


@kernel
def _correct_kernel(t: Array, T: Array, twist: Array, T_end: Array, twist_end: Array) -> None:
    last = len(t) - 1
    T_start = T[0].copy()
    correction = local_state_kernel(T_start, T_end, twist_end)
    correction -= local_state_kernel(T_start, T[last], twist[last])
    for k in range(1, last):
        weights = hermite_weights(t[k] - t[0], t[last] - t[k])
        local = local_state_kernel(T_start, T[k], twist[k])
        for i in range(2):
            for n in range(6):
                local[6 * i + n] += weights[1, i, 0] * correction[n]
                local[6 * i + n] += weights[1, i, 1] * correction[6 + n]
        retract_kernel(T_start, local, T[k], twist[k])
    copy_kernel(T_end, T[last])
    copy_vector_kernel(twist_end, twist[last])
