"""Joint covariances of neighbouring states, kept at knots a few milliseconds apart.

Between knots the Gaussian process interpolates covariances exactly, so that not every state's need
be kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from factors.wnoa import kronecker

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CovarianceKnots:
    """Times of M states, and how each and the next are uncertain together.

    Attributes
    ----------
    t
        (M,) times of states, seconds.
    joint
        (M - 1, 24, 24) joint covariances of pose and twist of one knot, then of the next.
    """

    t: Array = field(default_factory=lambda: np.empty(0))
    joint: Array = field(default_factory=lambda: np.empty((0, 24, 24)))

    @staticmethod
    def joined(parts: Sequence[CovarianceKnots]) -> CovarianceKnots:
        """Knots of parts in order of time; each part's first is the last one of the part before."""
        parts = [part for part in parts if len(part.t)]
        if not parts:
            return CovarianceKnots()
        t = [parts[0].t, *(part.t[1:] for part in parts[1:])]
        return CovarianceKnots(np.concatenate(t), np.concatenate([part.joint for part in parts]))

    @property
    def nbytes(self) -> int:
        """Size of the arrays."""
        return self.t.nbytes + self.joint.nbytes

    @staticmethod
    def extended(parts: Sequence[CovarianceKnots], later: CovarianceKnots) -> list[CovarianceKnots]:
        """The parts and a later one, whose estimate the last of them follows."""
        return [*parts[:-1], *(part.followed_by(later) for part in parts[-1:]), later]

    def followed_by(self, later: CovarianceKnots) -> CovarianceKnots:
        """These as they are once a later estimate, with covariances from their end on, moved it.

        The end's correction c is what the later estimate knows better, C = P - P', and independent
        of the error that it leaves. Of the errors of the knots before, G e is the part that the
        end's error e explains, and `joined` moves these knots by W c: (G - W) c is added to what
        they are uncertain by. This is why velocities between final states are less certain than at
        them.
        """
        if len(self.joint) == 0 or len(later.joint) == 0:
            return self
        before, after = self.joint[-1, 12:, 12:], later.joint[0, :12, :12]
        C = _positive_part(before - after, after)
        gains, weights = self._gains(), self._weights()
        G = np.concatenate([gains[:-1], gains[1:]], axis=1)
        left = G - np.concatenate([weights[:-1], weights[1:]], axis=1)
        change = G @ (after - before) @ G.transpose(0, 2, 1) + left @ C @ left.transpose(0, 2, 1)
        joint = self.joint + change
        return CovarianceKnots(self.t, 0.5 * (joint + joint.transpose(0, 2, 1)))

    def _gains(self) -> Array:
        """(M, 12, 12) regression of each knot's error on that of the last one."""
        gains = [np.eye(12)]
        for pair in self.joint[::-1]:
            step = np.linalg.solve(pair[12:, 12:], pair[12:, :12]).T
            gains.append(step @ gains[-1])
        return np.array(gains[::-1])

    def _weights(self) -> Array:
        """(M, 12, 12) of the last knot's correction in the one that each knot gets with it."""
        a, b = self.t - self.t[0], self.t[-1] - self.t
        dt = self.t[-1] - self.t[0]
        s, r = a / dt, b / dt
        small = [[s * s * (1 + 2 * r), -s * s * b], [6 * s * r / dt, s * (1 - 3 * r)]]
        return kronecker(np.array(small).transpose(2, 0, 1), np.eye(6))


def _positive_part(difference: Array, scale: Array) -> Array:
    """(12, 12) of a symmetric matrix, eigenvalues in units of a covariance's deviations."""
    unit = np.sqrt(np.diag(scale))
    value, vector = np.linalg.eigh(difference / np.outer(unit, unit))
    root = unit[:, None] * vector * np.sqrt(np.clip(value, 0, None))
    return root @ root.T
