"""Segments of a trajectory between breaks, each with covariances relative to its own first pose.

After a break the first pose is uncertain by decimetres, the motion from there on by millimetres.
One graph of both would lose the latter to linearisation. So the smoother begins again after a
break as if its first pose were known, and what that pose is uncertain by is added to its states':
the error e of the first pose is Ad(T_k^-1 T_first) e at the state k.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator.known_place import PoseInWorld
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.states import States

Array = NDArray[np.float64]


class SegmentKnots:
    """The knots of earlier segments, and how uncertain the present one's first pose is."""

    def __init__(self) -> None:
        self._earlier: list[CovarianceKnots] = []
        self._first = PoseInWorld(np.eye(4), np.zeros((6, 6)))

    @property
    def nbytes(self) -> int:
        """Size of the earlier segments' knots."""
        return sum(part.nbytes for part in self._earlier)

    def all_knots(self, states: States, knots: CovarianceKnots) -> CovarianceKnots:
        """Return all knots in the world, given those of the present segment and all states."""
        return CovarianceKnots.joined([*self._earlier, self._in_world(states, knots)])

    def begin(self, states: States, knots: CovarianceKnots) -> None:
        """Begin a segment at the end of the present one, given its knots and all states."""
        known = self._in_world(states, knots)
        if len(known.joint) == 0:  # the present segment is its first state alone
            return
        self._earlier.append(known)
        self._first = PoseInWorld(states.T_world_cam[-1], known.joint[-1, 12:18, 12:18])

    def begin_apart(
        self, states: States, knots: CovarianceKnots, t: float, pose: PoseInWorld, twist: Array
    ) -> None:
        """Begin a segment at a later time t, seconds, with a pose known otherwise.

        `twist` (6, 6) is the covariance of the twist there.
        """
        end = len(self._earlier)
        self.begin(states, knots)
        if len(self._earlier) > end:
            joint = np.zeros((1, 24, 24))
            joint[0, :12, :12] = self._earlier[-1].joint[-1, 12:, 12:]
            joint[0, 12:18, 12:18], joint[0, 18:, 18:] = pose.covariance, twist
            self._earlier.append(CovarianceKnots(np.array([states.t[-1], t]), joint))
        self._first = pose

    def pose_covariance(self, T_world_cam: Array) -> Array:
        """Return what the poses (N, 4, 4) are uncertain by as the first one is, (N, 6, 6)."""
        return self._first.carried_to(T_world_cam)

    def _in_world(self, states: States, knots: CovarianceKnots) -> CovarianceKnots:
        first = self._first
        if len(knots.t) == 0 or not first.covariance.any():
            return knots
        T = states.T_world_cam[np.searchsorted(states.t, knots.t)]
        moved = first.adjoint_to(T)
        by_first = np.zeros((len(T) - 1, 24, 6))
        by_first[:, :6], by_first[:, 12:18] = moved[:-1], moved[1:]
        added = by_first @ first.covariance @ by_first.transpose(0, 2, 1)
        return CovarianceKnots(knots.t, knots.joint + added)
