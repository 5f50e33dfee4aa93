"""Power spectral density of the acceleration, learned from the motion that is seen.

The WNOA errors e of the key states have the covariance Q(dt) = q Q_1(dt), so that their whitened
values w, for unit Q_c, have the variance q. So have the changes between neighbouring intervals,

    c = (w_next / sqrt(dt_next) - w / sqrt(dt)) / sqrt(1 / dt_next + 1 / dt),

which are zero where the acceleration is constant. Of a motion that is not white, errors tell the
density of slow accelerations, as those of a hand, and changes that of fast ones, as those of a
drone that shakes, which otherwise are smoothed away. The prior is ready for both: q is the larger.

After the measurements were used, the sum of n squares is expected to be q r, with the redundancy
r = n - trace(J P J^T) / q, where P is the covariance of the states and J the Jacobian. Therefore
sum / r estimates q: this is Foerstner's estimate of variance components (1979), one for rotation
and one for translation, over the recent past.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_adjoint, se3_inverse, se3_log, se3_right_jacobian_inverse
from factors.wnoa import information_root
from gpvo.estimator.isam2 import blocks_of_neighbours
from gpvo.trajectory.states import States

Array = NDArray[np.float64]

LEAST, MOST = 0.1, 1e4
"""Bounds of what is learned, as a share of the value at the start."""
TRUST = 5.0
"""Redundancy that the value at the start counts for."""


class MotionNoise:
    """Estimates Q_c over the recent past.

    Parameters
    ----------
    start
        (6,) diagonal of Q_c to begin with.
    memory
        Seconds after which what was seen counts 1/e of what is seen now.
    """

    def __init__(self, start: Array, memory: float) -> None:
        self._start, self._memory = start, memory
        # of errors and changes, each of rotation and translation
        self._squares, self._redundancy = np.full((2, 2), TRUST), np.full((2, 2), TRUST)
        self._until = -np.inf

    @property
    def qc(self) -> Array:
        """(6,) present diagonal of Q_c."""
        scale = np.clip(self._squares / self._redundancy, LEAST, MOST)
        return self._start * np.repeat(scale.max(axis=0), 3)

    def learn(self, states: States, covariance: Array, linearized: States | None = None) -> None:
        """Add what is known of consecutive states and their covariance (12 K, 12 K).

        `linearized` are the states at which that covariance was found, by default the same.
        """
        if len(states) < 2:
            return
        squares, redundancy = self._window(states, covariance, linearized or states)
        if not (np.isfinite(squares).all() and np.isfinite(redundancy).all()):
            return
        passed = min(states.t[-1] - self._until, self._memory * 10)
        keep = np.exp(-passed / self._memory)
        self._until = states.t[-1]
        self._squares = keep * self._squares + squares
        self._redundancy = keep * self._redundancy + np.maximum(redundancy, 0.0)

    def _window(self, states: States, covariance: Array, linearized: States) -> tuple[Array, Array]:
        """Compute squares, relative to the start's Q_c, and redundancies.

        Both are (2, 2): of errors and of changes, of rotation and translation.
        """
        dt = np.diff(states.t)
        root = information_root(dt)
        white = np.einsum("kab,kbi->kai", root, wnoa_errors(states))
        jacobian = white_jacobian(linearized, root)
        squares = [white**2, acceleration_changes(white[:-1], white[1:], dt) ** 2]
        variances = [
            axis_variances(of_states, covariance)
            for of_states in (jacobian, change_jacobian(jacobian, dt))
        ]
        return (
            np.stack([_by_component(both.sum(axis=1) / self._start) for both in squares]),
            np.stack([_by_component(2 - known / self.qc) for known in variances]),
        )


def _by_component(axes: Array) -> Array:
    """Add (K, 6) up to (2,): rotation and translation."""
    return np.asarray(axes.sum(axis=0).reshape(2, 3).sum(axis=1))


def acceleration_changes(before: Array, after: Array, dt: Array) -> Array:
    """Compute changes (K - 2, ...) from intervals to the next ones, of dt (K - 1,) seconds.

    `before` and `after` are what both have: whitened errors, or what is linear in them.
    """
    shares = np.sqrt(np.stack([dt[1:], dt[:-1]]) / (dt[1:] + dt[:-1]))
    of_before, of_after = shares[:, :, None, None]
    return np.asarray(of_after * after - of_before * before)


def change_jacobian(jacobian: Array, dt: Array) -> Array:
    """Compute the Jacobian (K - 2, 12, 36) of the changes from that of the errors."""
    of_before = np.pad(jacobian[:-1], ((0, 0), (0, 0), (0, 12)))
    of_after = np.pad(jacobian[1:], ((0, 0), (0, 0), (12, 0)))
    return acceleration_changes(of_before, of_after, dt)


def white_jacobian(states: States, root: Array) -> Array:
    """Compute the Jacobian (K - 1, 12, 24) of the whitened errors, unit Q_c, by state and next.

    `root` (K - 1, 2, 2) whitens them. What both poses have in common cancels only where the first
    one's error is seen from the second, hence the adjoint.
    """
    T, dt = states.T_world_cam, np.diff(states.t)
    jacobian = np.zeros((len(dt), 2, 6, 24))
    jacobian[:, 0, :, :6] = -se3_adjoint(se3_inverse(se3_inverse(T[:-1]) @ T[1:]))
    jacobian[:, 0, :, 6:12], jacobian[:, 0, :, 12:18] = -dt[:, None, None] * np.eye(6), np.eye(6)
    jacobian[:, 1, :, 6:12], jacobian[:, 1, :, 18:] = -np.eye(6), np.eye(6)
    white = np.einsum("kab,kbin->kain", root, jacobian)
    return np.asarray(white.reshape(-1, 12, 24))


def axis_variances(jacobian: Array, covariance: Array) -> Array:
    """Compute the sums (M, 6) of both variances of each axis, of (M, 12, 12 n) of n states."""
    blocks = blocks_of_neighbours(covariance, jacobian.shape[2] // 12)
    return np.asarray(((jacobian @ blocks) * jacobian).sum(axis=2).reshape(-1, 2, 6).sum(axis=1))


def wnoa_errors(states: States) -> Array:
    """Compute the errors (K - 1, 2, 6) of the WNOA prior between consecutive states."""
    twist = se3_log(se3_inverse(states.T_world_cam[:-1]) @ states.T_world_cam[1:])
    later = (se3_right_jacobian_inverse(twist) @ states.twist[1:, :, None])[..., 0]
    before, dt = states.twist[:-1], np.diff(states.t)[:, None]
    return np.stack([twist - dt * before, later - before], axis=1)
