"""Poses at absolute stamps, such as ground truth and trajectories of other systems."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError, about

ROTATION_TOLERANCE = 1e-3
"""Largest allowed entry of RᵀR - 1; files with four decimals pass. So for the last row."""

GAP_NS, GAP_INTERVALS = 500_000_000, 10
"""Nanoseconds, and usual intervals: between poses farther apart than both, none is known."""


@dataclass(frozen=True, eq=False)
class StampedPoses:
    """A sequence of poses with strictly increasing stamps.

    Attributes
    ----------
    stamps_ns
        (N,) int64, absolute nanoseconds.
    T_world_cam
        (N, 4, 4) float64 rigid transforms.

    Raises
    ------
    InputError
        If the shapes differ, a pose is not rigid or not finite, or the stamps do not increase.
    """

    stamps_ns: NDArray[np.int64]
    T_world_cam: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.T_world_cam.shape != (len(self.stamps_ns), 4, 4):
            raise InputError(
                f"{len(self.stamps_ns)} stamps do not fit poses of shape {self.T_world_cam.shape}"
            )
        if not np.isfinite(self.T_world_cam).all():
            raise InputError("poses must be finite numbers")
        bent = np.flatnonzero(~is_rigid(self.T_world_cam))
        if len(bent):
            raise InputError(
                f"pose {bent[0]} is no rigid transform: its rotation is skewed or mirrored, or its"
                " last row not 0 0 0 1"
            )
        late = np.flatnonzero(np.diff(self.stamps_ns) <= 0)
        if len(late):
            index = int(late[0]) + 1
            raise InputError(
                f"stamps must increase, but pose {index} at {seconds_text(self.stamps_ns[index])} s"
                f" follows one at {seconds_text(self.stamps_ns[index - 1])} s"
            )

    @staticmethod
    def read_from(
        place: str, stamps_ns: NDArray[np.int64], T_world_cam: NDArray[np.float64]
    ) -> StampedPoses:
        """Make poses that were read from a file; errors name `place`, a file or a part of one."""
        with about(place):
            return StampedPoses(stamps_ns, T_world_cam)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, index: slice | NDArray) -> StampedPoses:
        return StampedPoses(self.stamps_ns[index], self.T_world_cam[index])

    @property
    def seconds(self) -> NDArray[np.float64]:
        """(N,) seconds since the first pose."""
        return (self.stamps_ns - self.stamps_ns[0]) * 1e-9

    @property
    def rotations(self) -> NDArray[np.float64]:
        """(N, 3, 3) rotations R_world_cam."""
        return self.T_world_cam[:, :3, :3]

    @property
    def positions(self) -> NDArray[np.float64]:
        """(N, 3) positions of the camera in the world, metres."""
        return self.T_world_cam[:, :3, 3]

    def between(self, start_ns: int, stop_ns: int) -> StampedPoses:
        """Return the poses with start_ns <= stamp <= stop_ns."""
        first = np.searchsorted(self.stamps_ns, start_ns, side="left")
        last = np.searchsorted(self.stamps_ns, stop_ns, side="right")
        return self[first:last]

    @property
    def gaps_ns(self) -> NDArray[np.int64]:
        """(G, 2) stamps before and after each gap, in which the poses are unknown."""
        return gaps_of(self.stamps_ns)

    def interpolate(self, stamps_ns: ArrayLike) -> StampedPoses:
        """Interpolate at increasing stamps, linearly in position and in rotation (slerp).

        Raises
        ------
        InputError
            If there are fewer than two poses, or a stamp lies before the first or after the last.
        """
        query = np.asarray(stamps_ns, np.int64)
        self.require_cover(query)
        right = np.clip(np.searchsorted(self.stamps_ns, query, side="right"), 1, len(self) - 1)
        left = right - 1
        step_ns = self.stamps_ns[right] - self.stamps_ns[left]
        fraction = ((query - self.stamps_ns[left]) / step_ns)[:, None]

        start = Rotation.from_matrix(self.rotations[left])
        turn = (start.inv() * Rotation.from_matrix(self.rotations[right])).as_rotvec()
        rotations = (start * Rotation.from_rotvec(fraction * turn)).as_matrix()
        positions = (1.0 - fraction) * self.positions[left] + fraction * self.positions[right]
        return StampedPoses(query, rigid_transforms(rotations, positions))

    def require_cover(self, query: NDArray[np.int64]) -> None:
        """Raise InputError if these stamps cannot be interpolated."""
        if len(self) < 2:
            raise InputError("interpolation needs at least two poses")
        if len(query) and (query.min() < self.stamps_ns[0] or query.max() > self.stamps_ns[-1]):
            raise InputError(
                f"poses cover {seconds_text(self.stamps_ns[0])} to"
                f" {seconds_text(self.stamps_ns[-1])} s, not {seconds_text(query.min())} to"
                f" {seconds_text(query.max())} s"
            )

    def later(self, offset_ns: int) -> StampedPoses:
        """Return the same poses on a clock that is ahead by an offset, nanoseconds."""
        return replace(self, stamps_ns=self.stamps_ns + offset_ns)

    def seen_from(self, T_cam_body: NDArray[np.float64]) -> StampedPoses:
        """Return T_world_body of a body that is fixed to the camera, given T_cam_body (4, 4)."""
        return StampedPoses(self.stamps_ns, self.T_world_cam @ T_cam_body)

    def in_world(self, T_new_world: NDArray[np.float64]) -> StampedPoses:
        """Express the poses in another world frame, given T_new_world (4, 4)."""
        return StampedPoses(self.stamps_ns, T_new_world @ self.T_world_cam)


def gaps_of(stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the stamps (G, 2) before and after each gap of increasing stamps (N,)."""
    intervals = np.diff(stamps_ns)
    usual = np.median(intervals) if len(intervals) else 0.0
    before = np.flatnonzero(intervals > max(GAP_NS, GAP_INTERVALS * usual))
    return np.stack([stamps_ns[before], stamps_ns[before + 1]], axis=1)


def is_rigid(transforms: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which transforms (N, 4, 4) are a rotation, without mirror, and a translation."""
    R = transforms[:, :3, :3]
    skewed = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2))
    last_row = np.abs(transforms[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1)
    straight = np.maximum(skewed, last_row) <= ROTATION_TOLERANCE
    return np.asarray(straight & (np.linalg.det(R) > 0.0))


def rigid_transforms(
    rotations: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the transforms (N, 4, 4) of rotations (N, 3, 3) and positions (N, 3)."""
    transforms = np.zeros((len(positions), 4, 4))
    transforms[:, :3, :3] = rotations
    transforms[:, :3, 3] = positions
    transforms[:, 3, 3] = 1.0
    return transforms


def quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternions (N, 4) of rotations (N, 3, 3): x, y, z, w with w >= 0."""
    return Rotation.from_matrix(rotations).as_quat(canonical=True)


def seconds_text(stamp_ns: int) -> str:
    """Format a stamp in seconds with nine decimals, exactly."""
    sign, magnitude = "-" if stamp_ns < 0 else "", abs(int(stamp_ns))
    return f"{sign}{magnitude // 10**9}.{magnitude % 10**9:09d}"
