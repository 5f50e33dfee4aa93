"""Power spectral density of the acceleration, learned from the motion that is seen.

The WNOA errors e of the key states have the covariance Q(dt) = q Q_1(dt). After the measurements
were used, e^T Q^-1 e is expected to be the redundancy r = n - trace(Q^-1 J P J^T), where P is the
covariance of the states and J the Jacobian of e. Therefore q e^T Q^-1 e / r estimates q: this is
Foerstner's estimate of variance components (1979), one for rotation and one for translation, over
the recent past.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_adjoint, se3_inverse, se3_log, se3_right_jacobian_inverse
from factors.wnoa import information_root
from gpvo.estimator.isam2 import pairs_of_neighbours
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
        self._squares, self._redundancy = np.full(2, TRUST), np.full(2, TRUST)
        self._until = -np.inf

    @property
    def qc(self) -> Array:
        """(6,) present diagonal of Q_c."""
        scale = np.clip(self._squares / self._redundancy, LEAST, MOST)
        return self._start * np.repeat(scale, 3)

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
        """Compute squared errors, relative to the start's Q_c, and redundancies, (2,) each."""
        dt = np.diff(states.t)
        error = wnoa_errors(states)
        root = information_root(dt)  # (K - 1, 2, 2)
        white = np.einsum("kab,kbi->kai", root, error) / np.sqrt(self._start)
        spread = relative_spread(linearized, covariance, root)
        squares = (white**2).sum(axis=(0, 1)).reshape(2, 3).sum(axis=1)
        redundancy = (2 - spread / self.qc).sum(axis=0).reshape(2, 3).sum(axis=1)
        return squares, redundancy


def relative_spread(states: States, covariance: Array, root: Array) -> Array:
    """Compute the traces (K - 1, 6) of the whitened errors' covariances, axis by axis, unit Q_c.

    `root` (K - 1, 2, 2) whitens them. What both poses have in common cancels only where the first
    one's error is seen from the second, hence the adjoint.
    """
    T, dt = states.T_world_cam, np.diff(states.t)
    jacobian = np.zeros((len(dt), 2, 6, 24))
    jacobian[:, 0, :, :6] = -se3_adjoint(se3_inverse(se3_inverse(T[:-1]) @ T[1:]))
    jacobian[:, 0, :, 6:12], jacobian[:, 0, :, 12:18] = -dt[:, None, None] * np.eye(6), np.eye(6)
    jacobian[:, 1, :, 6:12], jacobian[:, 1, :, 18:] = -np.eye(6), np.eye(6)
    white = np.einsum("kab,kbin->kain", root, jacobian).reshape(-1, 12, 24)
    variances = (white @ pairs_of_neighbours(covariance) * white).sum(axis=2)
    return np.asarray(variances.reshape(-1, 2, 6).sum(axis=1))


def wnoa_errors(states: States) -> Array:
    """Compute the errors (K - 1, 2, 6) of the WNOA prior between consecutive states."""
    twist = se3_log(se3_inverse(states.T_world_cam[:-1]) @ states.T_world_cam[1:])
    later = (se3_right_jacobian_inverse(twist) @ states.twist[1:, :, None])[..., 0]
    before, dt = states.twist[:-1], np.diff(states.t)[:, None]
    return np.stack([twist - dt * before, later - before], axis=1)
