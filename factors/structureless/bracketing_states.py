"""The states that measurements lie between, each at its own time."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_array
from factors.kernels.se3 import Array
from factors.mounting import camera_by_body
from factors.structureless.states_between_kernels import poses_between_kernel
from factors.variables import Variable, variables_at


def checked_times(times: ArrayLike, count: int) -> Array:
    """(count,) finite seconds."""
    t = checked_array("times", times, ())
    if t.shape != (count,):
        raise ValueError(f"times must have one entry for each of {count} measurements")
    return t


class BracketingStates:
    """The states that bracket a time, or all if asked for, and the poses at the times.

    Attributes
    ----------
    states
        (pose key, velocity key, time) of the m states.
    t
        (m,) their times, seconds.
    first
        (n,) the first of its two states for each time.
    a, b
        (n,) seconds from that one, and to the next.
    by_body
        (6, 6) Jacobian of the camera's pose and twist with respect to the body's, if the states are
        those of a body that carries the camera at T_body_cam (4, 4).
    """

    def __init__(
        self,
        t: Array,
        states: Sequence[tuple[int, int, float]],
        every: bool = False,
        T_body_cam: Array | None = None,
    ) -> None:
        t_states = checked_array("states", [time for _, _, time in states], ())
        if len(t_states) < 2 or (np.diff(t_states) <= 0).any():
            raise ValueError("states must be two or more in order of time")
        if len(t) and (t.min() < t_states[0] or t.max() > t_states[-1]):
            raise ValueError(
                f"times from {t.min()} to {t.max()} must lie between the states' {t_states[0]} "
                f"and {t_states[-1]}"
            )
        first = np.minimum(np.searchsorted(t_states, t, side="right"), len(t_states) - 1) - 1
        self.a, self.b = t - t_states[first], t_states[first + 1] - t
        used = np.arange(len(states)) if every else np.union1d(first, first + 1)
        self.states = [states[i] for i in used.tolist()]
        self.t = t_states[used]
        self.first = np.searchsorted(used, first).astype(np.int64)
        self.T_body_cam = T_body_cam
        self.by_body = None if T_body_cam is None else camera_by_body(T_body_cam)

    def at(self, t: Array) -> BracketingStates:
        """Return the same states with other times."""
        return BracketingStates(t, self.states, True, self.T_body_cam)

    @property
    def variables(self) -> list[Variable]:
        """Pose and velocity of each state."""
        return variables_at(self.states)

    @property
    def keys(self) -> list[int]:
        """Keys of the variables."""
        return [variable.key for variable in self.variables]

    def read(self, values: gtsam.Values) -> tuple[Array, Array]:
        """Poses (m, 4, 4) and velocities (m, 6) of the camera at the states."""
        T_states, v_states = np.empty((len(self.states), 4, 4)), np.empty((len(self.states), 6))
        for i, (pose, velocity, _) in enumerate(self.states):
            T_states[i] = values.atPose3(pose).matrix()
            v_states[i] = values.atVector6(velocity)
        if self.T_body_cam is not None and self.by_body is not None:
            T_states, v_states = T_states @ self.T_body_cam, v_states @ self.by_body.T
        return T_states, v_states

    def poses(self, T_states: Array, v_states: Array, count: int | None = None) -> Array:
        """Return the poses (n, 4, 4) at the times, or between the first `count` states alone."""
        states = len(self.states) if count is None else count
        return poses_between_kernel(T_states, v_states, self.first, self.a, self.b, states)
