"""States that left the window: the latest still follow its corrections, the others are final.

A window moves the state that it starts with from where the window before it had it, and the states
before that one are no longer in it. The error of a pose is a random walk, so that the states of the
last moment share the pose's correction; the Gaussian process says how the states of the latest
piece move along with the rest, which is of the velocity. Section III-C.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from factors.kernels.local_variables import hermite_weights, local_state_kernel, retract_kernel
from factors.kernels.matrices import copy_kernel, copy_vector_kernel
from factors.kernels.se3 import compose_exp_kernel
from factors.lie import se3_inverse, se3_log
from gpvo.trajectory.states import States, later_states

Array = NDArray[np.float64]


class FinalStates:
    """Collects the states that leave the window, in order of time.

    Parameters
    ----------
    settling
        Time in which states that left still follow corrections, seconds; with 0 only those since
        the key state before do.

    Attributes
    ----------
    settling
        States that left, and may still change.
    """

    def __init__(self, settling: float) -> None:
        self._duration, self._begin = settling, np.inf
        self._final: list[States] = []
        self.settling = States()

    @property
    def first(self) -> States | None:
        """The earliest states, if there are any."""
        earliest = self._final[0] if self._final else self.settling
        return earliest if len(earliest) else None

    @property
    def parts(self) -> list[States]:
        """All states that left, in parts."""
        return [*self._final, self.settling]

    @property
    def nbytes(self) -> int:
        """Size of the states."""
        return sum(part.nbytes for part in self.parts)

    def after(self, t: float) -> States:
        """Return the final states later than t, seconds."""
        return later_states(self._final, t)

    def extend(self, piece: States, end: States) -> None:
        """Add states (K,), of which the last one stays in the window, and is `end` (1,) now."""
        if len(piece) == 0:
            return
        self._begin = min(self._begin, float(piece.t[0]))
        start = max(self._begin, float(piece.t[-1]) - self._duration)
        left = States.concatenate([self.settling, piece])
        left = share_correction(left, start, end)
        piece = correct_final_states(left[len(self.settling) :], end)[:-1]
        left = States.concatenate([left[: len(self.settling)], piece])
        count = int(np.searchsorted(left.t, start))
        self._keep(left[:count])
        self.settling = left[count:]

    def end_segment(self, last: States) -> None:
        """Add the last states (K,) of a segment; all states so far are final."""
        self._keep(self.settling)
        self._keep(last)
        self._begin, self.settling = np.inf, States()

    def end_guessed(self, last: States, since: float, found: States) -> None:
        """Do so where the motion since a time, seconds, is guessed, and `found` (1,) comes next.

        The states that are not final lead there: else the path would jump.
        """
        guessed = States.concatenate([self.settling, last])
        self.settling = States()
        self.end_segment(led_to(guessed, since, found))

    def _keep(self, states: States) -> None:
        # A copy: a view would hold the memory of the settling states, too, of each moment.
        self._final += [States.concatenate([states])] if len(states) else []


def led_to(states: States, since: float, end: States) -> States:
    """Let the states (K,) after a time, seconds, lead to a later state (1,)."""
    ahead = States.concatenate([states, states[-1:].at(end.t)])
    return share_correction(ahead, max(since, float(states.t[0])), end)[:-1]


def share_correction(states: States, start: float, end: States) -> States:
    """Move the pose of the last of the states (K,) to that of `end` (1,), and others by a share.

    With the correction D = T_end T_last^-1 the pose T(t) becomes D^a T(t). The share a grows
    linearly from 0 at `start`, seconds, to 1: the mean of a random walk, given both ends. Twists
    follow: da/dt of Ad(T(t)^-1) log D is added.
    """
    duration = states.t[-1] - start
    if duration <= 0:
        return states
    correction = se3_log(end.T_world_cam[0] @ se3_inverse(states.T_world_cam[-1]))
    T, twist = states.T_world_cam.copy(), states.twist.copy()
    _share_kernel(states.t - start, duration, correction, T, twist)
    return States(states.t, T, twist)


@kernel
def _share_kernel(t: Array, duration: float, correction: Array, T: Array, twist: Array) -> None:
    before, move = np.empty((4, 4)), np.empty(6)
    for k in range(len(t)):
        if t[k] >= 0:
            copy_kernel(T[k], before)
            _seen_from(before, correction, move)
            compose_exp_kernel(before, t[k] / duration * move, T[k])
            for n in range(6):
                twist[k, n] += move[n] / duration


@kernel
def _seen_from(T: Array, world: Array, body: Array) -> None:
    """Set the twist (6,) of the body, Ad(T^-1) times that of the world."""
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    a = world[3] - y * world[2] + z * world[1]
    b = world[4] - z * world[0] + x * world[2]
    c = world[5] - x * world[1] + y * world[0]
    for i in range(3):
        body[i] = T[0, i] * world[0] + T[1, i] * world[1] + T[2, i] * world[2]
        body[3 + i] = T[0, i] * a + T[1, i] * b + T[2, i] * c


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
