"""Power spectral density of the acceleration, learned from the motion that is seen.

The WNOA errors of the key states, whitened and relative to the root of Q_c, have the variance 1 of
each axis. Their estimate is y, and its covariance P: the share of it that the measurements tell is
G = 1 - P. What is smoothed away of the motion, and what of the noise is not, are together expected
to be least, in units of the measurements' noise, where

    y^T P y = tr(P G).

This is the derivative of Stein's unbiased estimate of the risk (1981) with respect to log Q_c. Of
all frequencies those count with P G, so that Q_c is the density of accelerations where the smoother
begins to leave them away: slower ones are followed whatever it is, and quicker ones lost. Maximum
likelihood, y^T y = tr G, is their mean density, which for a drone that shakes is too small, and for
a hand or a car too large.

Each axis has its own. y^T P y / tr(P G) times the present Q_c is a step to its solution, with sums
over the window and the recent past.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_adjoint, se3_inverse, se3_log, se3_right_jacobian_inverse
from factors.wnoa import information_root
from gpvo.estimator.state_times import SAME_TIME
from gpvo.trajectory.states import States

Array = NDArray[np.float64]

LEAST, MOST = 0.1, 1e4
"""Bounds of what is learned, as a share of the value at the start."""
TRUST = 0.3
"""Weight, a sum of P G, that the value at the start counts for."""
POOLED = 3.0
"""Weight that the mean of the three axes of rotation, or translation, counts for in each."""


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
        # y^T P y, times Q_c relative to the start's, and tr(P G): of each axis, and each interval
        self._past, self._window = np.zeros((2, 6)), np.zeros((2, 6, 0))
        self._stops = np.zeros(0)

    @property
    def qc(self) -> Array:
        """(6,) present diagonal of Q_c."""
        sums = (self._past + self._window.sum(axis=2) + TRUST).reshape(2, 2, 3)
        mean = np.divide(*sums.sum(axis=2, keepdims=True))
        scale = (sums[0] + POOLED * mean) / (sums[1] + POOLED)
        return self._start * np.clip(scale.ravel(), LEAST, MOST)

    def learn(
        self,
        states: States,
        covariance: Array,
        linearized: States | None = None,
        acceleration: Array | None = None,
    ) -> None:
        """Add what is known of consecutive states and their covariance (12 K, 12 K).

        What was said of intervals that are still among them is replaced. `linearized` are the
        states at which that covariance was found, by default the same. `acceleration` (K - 1, 6) is
        the mean that the priors between them have, by default 0.
        """
        if len(states) < 2:
            return
        qc = self.qc
        window = interval_sums(states, covariance, linearized or states, qc, acceleration)
        if not np.isfinite(window).all():
            return
        window[0] *= (qc / self._start)[:, None]
        self._leave(states.t)
        self._window, self._stops = window, states.t[1:]

    def _leave(self, t: Array) -> None:
        """Let what is before states at times (K,) be the past, and forget some of it."""
        if len(self._stops):
            passed = min((t[-1] - self._stops[-1]) / self._memory, 10.0)
            self._past *= np.exp(-passed)
        self._past += self._window[:, :, self._stops <= t[0] + SAME_TIME].sum(axis=2)


def interval_sums(
    states: States,
    covariance: Array,
    linearized: States,
    qc: Array,
    acceleration: Array | None = None,
) -> Array:
    """Compute each interval's share (2, 6, K - 1) of y^T P y and tr(P G), by axis."""
    size, root = len(states) - 1, information_root(np.diff(states.t))
    white = np.einsum("kab,kbi->kai", root, wnoa_errors(states, acceleration))
    y = (white / np.sqrt(qc)).transpose(2, 0, 1).reshape(6, 2 * size)
    jacobian = axis_jacobians(linearized, root)
    P = jacobian @ covariance @ jacobian.swapaxes(1, 2) / qc[:, None, None]
    squares = y * np.einsum("aij,aj->ai", P, y)
    weight = np.diagonal(P, 0, 1, 2) - (P * P).sum(axis=2)
    return np.stack([squares, np.maximum(weight, 0.0)]).reshape(2, 6, size, 2).sum(axis=3)


def axis_jacobians(states: States, root: Array) -> Array:
    """Compute the Jacobians (6, 2 (K - 1), 12 K) of the whitened errors of each axis, unit Q_c."""
    k = np.arange(len(states) - 1)
    blocks = white_jacobian(states, root)
    jacobian = np.zeros((len(k), 2, 6, len(states), 12))
    jacobian[k, :, :, k], jacobian[k, :, :, k + 1] = blocks[..., :12], blocks[..., 12:]
    return np.asarray(jacobian.transpose(2, 0, 1, 3, 4).reshape(6, 2 * len(k), 12 * len(states)))


def white_jacobian(states: States, root: Array) -> Array:
    """Compute the Jacobian (K - 1, 2, 6, 24) of the whitened errors, unit Q_c, by state and next.

    `root` (K - 1, 2, 2) whitens them. What both poses have in common cancels only where the first
    one's error is seen from the second, hence the adjoint.
    """
    T, dt = states.T_world_cam, np.diff(states.t)
    jacobian = np.zeros((len(dt), 2, 6, 24))
    jacobian[:, 0, :, :6] = -se3_adjoint(se3_inverse(se3_inverse(T[:-1]) @ T[1:]))
    jacobian[:, 0, :, 6:12], jacobian[:, 0, :, 12:18] = -dt[:, None, None] * np.eye(6), np.eye(6)
    jacobian[:, 1, :, 6:12], jacobian[:, 1, :, 18:] = -np.eye(6), np.eye(6)
    return np.asarray(np.einsum("kab,kbin->kain", root, jacobian))


def wnoa_errors(states: States, acceleration: Array | None = None) -> Array:
    """Compute the errors (K - 1, 2, 6) of the WNOA prior between consecutive states.

    `acceleration` (K - 1, 6) is its mean, by default 0.
    """
    twist = se3_log(se3_inverse(states.T_world_cam[:-1]) @ states.T_world_cam[1:])
    later = (se3_right_jacobian_inverse(twist) @ states.twist[1:, :, None])[..., 0]
    before, dt = states.twist[:-1], np.diff(states.t)[:, None]
    mean = np.zeros(6) if acceleration is None else acceleration
    expected = dt * (before + 0.5 * dt * mean), before + dt * mean
    return np.stack([twist - expected[0], later - expected[1]], axis=1)
