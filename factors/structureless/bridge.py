"""States at the times of measurements, between two neighbouring states of a graph.

Given both states, the local variables (xi, w) at a time between are Gaussian: their mean is the
interpolation, and their deviations from it have the covariance of a bridge, k(t, t') Q_c. As the
states at all measurement times are tied to one another by the prior alone, few of them carry the
rest: r of the deviations, at times found by a Cholesky factorisation with pivoting, are
independent unit variables u (6 r,), and the others follow from them up to a variance that the
tolerance bounds. With as many as there are times the representation is exact. Section III-C of
Wang and Gammell; Barfoot, "State Estimation for Robotics", chapter 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import bare_kernel, kernel
from factors.kernels.matrices import copy_kernel
from factors.kernels.se3 import Array

_FEW = 32  # columns to begin with; so many are rarely needed
_ROUNDING = 1e-13  # of a variance: what is left of it after elimination is no number any more


@dataclass(frozen=True, eq=False)
class Bridge:
    """Deviations from the interpolation between two states.

    Attributes
    ----------
    duration
        Seconds between the states.
    gains
        (m, r) deviation of xi at the m measurement times, per root of Q_c, by the r variables u of
        each of its six components.
    pivots
        (r,) seconds after the first state where u determines xi exactly.
    """

    duration: float
    gains: Array
    pivots: Array
    _root: Array

    @staticmethod
    def through(times: Array, duration: float, scale: Array, tolerance: float) -> Bridge:
        """Bridge through the measurement times (m,), seconds after the first state.

        `scale` (m,) is the squared whitened error that a deviation of variance Q_c causes; what is
        left of it by the r variables is at most `tolerance`.
        """
        gains, pivots = pivoted_cholesky_kernel(times, duration, scale, tolerance)
        return Bridge(duration, gains, times[pivots], gains[pivots])

    @staticmethod
    def rigid(count: int, duration: float) -> Bridge:
        """Bridge without deviations: every state between is the interpolated one."""
        return Bridge(duration, np.zeros((count, 0)), np.empty(0), np.empty((0, 0)))

    @property
    def rank(self) -> int:
        """Number r of variables of each component."""
        return len(self.pivots)

    def weights(self, times: Array) -> Array:
        """(2, n, r) deviations of xi and of w at any times (n,), per root of Q_c, by u."""
        cross = bridge_covariance(times, self.pivots, self.duration)[:, 0]
        if self.rank == 0:
            return cross
        flat = np.linalg.solve(self._root, cross.reshape(-1, self.rank).T).T
        return np.asarray(flat.reshape(2, len(times), self.rank), np.float64)

    def deviations(self, times: Array, u: Array) -> Array:
        """(n, 12) deviations of (xi, w) at any times (n,), per root of Q_c, of u (6, r)."""
        result = np.zeros((len(times), 12))
        if self.rank:
            coefficients = np.ascontiguousarray(np.linalg.solve(self._root.T, u.T))
            deviations_kernel(times, self.pivots, self.duration, coefficients, result)
        return result

    def left(self, times: Array) -> Array:
        """(2, 2, n, n) covariance of (xi, w) at times (n,) that u leaves, per unit of Q_c."""
        weights = self.weights(times)
        explained = np.einsum("imr,jnr->ijmn", weights, weights)
        return bridge_covariance(times, times, self.duration) - explained


@kernel
def bridge_covariance(a: Array, b: Array, duration: float) -> Array:
    """(2, 2, m, n) covariance of (xi, w) at times a (m,) with (xi, w) at times b (n,).

    Per unit of power spectral density, given the states at 0 and at `duration`, seconds.
    """
    result = np.empty((2, 2, len(a), len(b)))
    d, at_a, at_b, known = duration, np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for m in range(len(a)):
        _wiener_kernel(a[m], d, at_a)
        for n in range(len(b)):
            _wiener_kernel(b[n], d, at_b)
            _wiener_kernel(a[m], b[n], known)
            for i in range(2):
                x, w = at_a[i, 0], at_a[i, 1]
                by_x, by_w = (12 * x / d - 6 * w) / (d * d), (4 * w - 6 * x / d) / d
                for j in range(2):
                    explained = by_x * at_b[j, 0] + by_w * at_b[j, 1]
                    result[i, j, m, n] = known[i, j] - explained
    return result


@bare_kernel
def _wiener_kernel(a: float, b: float, covariance: Array) -> None:
    """Write the covariance (2, 2) of `bridge_covariance`, given the state at 0 alone."""
    first, last = min(a, b), max(a, b)
    covariance[0, 0] = first * first * (3 * last - first) / 6
    covariance[0, 1] = a * a / 2 if a <= b else b * (a - b / 2)
    covariance[1, 0] = b * b / 2 if b <= a else a * (b - a / 2)
    covariance[1, 1] = first


@kernel
def deviations_kernel(
    times: Array, pivots: Array, duration: float, coefficients: Array, result: Array
) -> None:
    """Add to result (n, 12) covariances of (xi, w) with xi at the pivots, by coefficients (r, 6).

    The covariance of w(t) with xi(p) is the derivative of that of xi(t) by t.
    """
    d = duration
    for n in range(len(times)):
        for k in range(len(pivots)):
            t, p = times[n], pivots[k]
            value, s, q = _covariance_kernel(t, p, d), t, p
            if t > p:  # the same from the other end
                s, q = d - t, d - p
            rest = d - q
            slope = s * rest * rest * (6 * d * q - 3 * s * (d + 2 * q)) / (6 * d * d * d)
            slope = -slope if t > p else slope
            for j in range(6):
                result[n, j] += value * coefficients[k, j]
                result[n, 6 + j] += slope * coefficients[k, j]


@kernel
def pivoted_cholesky_kernel(
    times: Array, duration: float, scale: Array, tolerance: float
) -> tuple[Array, NDArray[np.int64]]:
    """G (m, r), GGᵀ = k(times, times) up to the tolerance, and the pivots (r,), numbers of times.

    Pivots are taken until scale * (k - GGᵀ) is nowhere larger than the tolerance on the diagonal.
    """
    m, rank = len(times), 0
    gains, left, pivots = np.empty((m, _FEW)), np.empty(m), np.empty(m, np.int64)
    for n in range(m):
        left[n] = _covariance_kernel(times[n], times[n], duration)
    while rank < m:
        best = 0
        for n in range(1, m):
            if left[n] * scale[n] > left[best] * scale[best]:
                best = n
        rounding = _ROUNDING * _covariance_kernel(times[best], times[best], duration)
        if not (left[best] * scale[best] > tolerance and left[best] > rounding):
            break
        if rank == gains.shape[1]:
            wider = np.empty((m, 2 * rank))
            copy_kernel(gains, wider)
            gains = wider
        pivots[rank], root = best, np.sqrt(left[best])
        for n in range(m):
            value = _covariance_kernel(times[n], times[best], duration)
            for k in range(rank):
                value -= gains[n, k] * gains[best, k]
            gains[n, rank] = value / root
            left[n] -= gains[n, rank] * gains[n, rank]
        left[best] = 0.0
        rank += 1
    return gains[:, :rank].copy(), pivots[:rank].copy()


@bare_kernel
def _covariance_kernel(s: float, t: float, d: float) -> float:
    """Covariance k of xi at the times s and t of a bridge of duration d.

    k = a^2 r^2 (3 b s' - a r ...) in closed form: a <= b the times, products of positive numbers.
    """
    a, b = min(s, t), max(s, t)
    rest = d - b
    return a * a * rest * rest * (3 * d * b - a * (d + 2 * b)) / (6 * d * d * d)
