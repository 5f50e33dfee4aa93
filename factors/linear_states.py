"""A factor that is linear in states: what was marginalized, or measured elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from factors.checks import checked_array, checked_key, checked_poses
from factors.factor import Factor
from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_vector_kernel
from factors.kernels.se3 import Array, log_kernel, relative_kernel
from factors.variables import POSE3, TWIST, Variable


class LinearStatesFactor(Factor):
    """Errors that are linear in how far states have moved: J dx + e ~ N(0, 1).

    Parameters
    ----------
    keys
        Pose3 and velocity (6,) of m states, in turn.
    T_states, v_states
        (m, 4, 4) and (m, 6) states that dx is counted from, poses perturbed on the right.
    rows
        (n, 12 m + 1) J, and e in the last column.

    Notes
    -----
    The Jacobian of a pose is that at T_states: exact there, and wrong by half the step of the pose,
    in rad, elsewhere.
    """

    def __init__(self, keys: Sequence[int], T_states: Array, v_states: Array, rows: Array) -> None:
        keys = [checked_key("keys", key) for key in keys]
        T_states = checked_poses("T_states", T_states).copy()
        v_states = checked_array("v_states", v_states, (6,)).copy()
        if not (v_states.ndim == 2 and len(keys) == 2 * len(T_states) == 2 * len(v_states)):
            raise ValueError(f"keys must be two for each of {len(T_states)} states")
        rows = checked_array("rows", rows, (6 * len(keys) + 1,)).copy()
        if rows.ndim != 2:
            raise ValueError(f"rows must have the shape (n, {rows.shape[-1]}), not {rows.shape}")

        def error(values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
            T = np.array([values.atPose3(key).matrix() for key in keys[::2]])
            v = np.array([values.atVector6(key) for key in keys[1::2]])
            moved = steps_kernel(T_states, v_states, T, v)
            if jacobians is not None:
                for block in range(len(keys)):
                    jacobians[block] = rows[:, 6 * block : 6 * block + 6]
            return rows[:, :-1] @ moved + rows[:, -1]

        variables = [
            Variable(f"keys[{n}]", key, TWIST if n % 2 else POSE3) for n, key in enumerate(keys)
        ]
        made_of = {"keys": keys, "T_states": T_states, "v_states": v_states, "rows": rows}
        super().__init__(gtsam.noiseModel.Unit.Create(len(rows)), variables, error, made_of)


@kernel
def steps_kernel(T: Array, v: Array, T_now: Array, v_now: Array) -> Array:
    """(12 m,) steps from states (m, 4, 4), (m, 6) to where they are now, poses on the right."""
    steps = np.empty((len(T), 12))
    for k in range(len(T)):
        copy_vector_kernel(log_kernel(relative_kernel(T[k], T_now[k])), steps[k])
        for i in range(6):
            steps[k, 6 + i] = v_now[k, i] - v[k, i]
    return steps.ravel()
