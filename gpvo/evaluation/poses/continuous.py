"""Stamped poses of a continuous trajectory, evaluated at any time instead of interpolated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpvo.trajectory import StampedPoses, Trajectory


@dataclass(frozen=True, eq=False)
class ContinuousPoses(StampedPoses):
    """Poses at the states of a trajectory, which gives the exact poses at other times."""

    trajectory: Trajectory

    @staticmethod
    def of(trajectory: Trajectory) -> ContinuousPoses:
        """Return the poses at a trajectory's states."""
        poses = trajectory.stamped_poses()
        return ContinuousPoses(poses.stamps_ns, poses.T_world_cam, trajectory)

    @property
    def gaps_ns(self) -> NDArray[np.int64]:
        """(0, 2): the Gaussian process is known between all states."""
        return np.empty((0, 2), np.int64)

    def later(self, offset_ns: int) -> ContinuousPoses:
        """Return the same trajectory on a clock that is ahead by an offset, nanoseconds."""
        start_ns = self.trajectory.start_ns + offset_ns
        return ContinuousPoses.of(replace(self.trajectory, start_ns=start_ns))

    def interpolate(self, stamps_ns: ArrayLike) -> StampedPoses:
        """Return the poses of the trajectory's own Gaussian process at increasing stamps.

        Raises
        ------
        InputError
            If a stamp lies before the first state or after the last.
        """
        query = np.asarray(stamps_ns, np.int64)
        self.require_cover(query)
        trajectory = self.trajectory
        seconds = (query - trajectory.start_ns) * 1e-9
        # Stamps are rounded to nanoseconds, so the first and last may lie just outside.
        inside = np.clip(seconds, trajectory.start, trajectory.stop)
        return StampedPoses(query, trajectory.pose(inside))
