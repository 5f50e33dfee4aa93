"""A factor that is linear in states: what was marginalized, or measured elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from factors.kernels import Array
from factors.lie import se3_inverse, se3_log


class LinearStatesFactor(gtsam.CustomFactor):
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
        T_inverse, v_states = se3_inverse(T_states), v_states.copy()

        def error(
            _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
        ) -> Array:
            T = np.array([values.atPose3(key).matrix() for key in keys[::2]])
            v = np.array([values.atVector(key) for key in keys[1::2]])
            moved = np.hstack([se3_log(T_inverse @ T), v - v_states]).ravel()
            if jacobians is not None:
                for block in range(len(keys)):
                    jacobians[block] = rows[:, 6 * block : 6 * block + 6]
            return rows[:, :-1] @ moved + rows[:, -1]

        super().__init__(gtsam.noiseModel.Unit.Create(len(rows)), list(keys), error)
