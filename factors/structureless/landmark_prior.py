"""What is known of landmarks from measurements whose states have left a window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array
from factors.kernels.se3 import Array
from factors.stereo import Camera, as_camera
from factors.structureless.prior_kernels import moved_rows_kernel, prior_system_kernel


@dataclass(frozen=True, eq=False)
class LandmarkPrior:
    """Landmarks as they are seen from the first state of a window, given that state.

    For each landmark it is one measurement q = (x / z, y / z, 1 / z) in a view from that state: the
    camera's frame, turned so that the landmark is ahead. Its error also depends on the state x and
    on variables s that all landmarks share: R (q - seen) + A dx + C s + e ~ N(0, 1), s ~ N(0, 1).
    It has no information on the state itself; that is in the graph. All is relative to the camera,
    so that no shift or turn of the world changes it.

    Attributes
    ----------
    number
        (P,) increasing identities of the landmarks.
    seen
        (P, 3) coordinates that the errors were linearized at.
    R_cam_view
        (P, 3, 3) turns of the views.
    root, rows
        R (P, 3, 3), and C, A and e beside each other, (P, 3, d + 12 + 1).
    T_world_cam, velocity
        (4, 4) and (6,) state that dx is counted from: pose perturbed on the right, then twist.

    Raises
    ------
    ValueError
        If one has another shape or is not finite, or the identities do not increase.
    """

    number: NDArray[np.int64]
    seen: Array
    R_cam_view: Array
    root: Array
    rows: Array
    T_world_cam: Array
    velocity: Array

    def __post_init__(self) -> None:
        number = np.asarray(self.number)
        integers = number.ndim == 1 and (number.dtype.kind in "iu" or not number.size)
        if not integers or (number[1:] <= number[:-1]).any():
            raise ValueError("number must be increasing integers, (P,)")
        count, columns = len(number), np.shape(self.rows)[-1] if np.ndim(self.rows) else 0
        object.__setattr__(self, "number", number.astype(np.int64))
        for name, shape in (
            ("seen", (count, 3)),
            ("R_cam_view", (count, 3, 3)),
            ("root", (count, 3, 3)),
            ("rows", (count, 3, max(columns, 13))),
            ("T_world_cam", (4, 4)),
            ("velocity", (6,)),
        ):
            array = checked_array(name, getattr(self, name), shape)
            if array.ndim != len(shape):
                raise ValueError(f"{name} must have the shape {shape}, not {array.shape}")
            object.__setattr__(self, name, array)

    @staticmethod
    def none() -> LandmarkPrior:
        """Prior of no landmark."""
        return LandmarkPrior(
            np.empty(0, np.int64),
            np.empty((0, 3)),
            np.empty((0, 3, 3)),
            np.empty((0, 3, 3)),
            np.empty((0, 3, 13)),
            np.eye(4),
            np.zeros(6),
        )

    def __len__(self) -> int:
        return len(self.number)

    @property
    def shared(self) -> int:
        """Number d of the variables s."""
        return self.rows.shape[2] - 13

    @property
    def by_shared(self) -> Array:
        """C (P, 3, d)."""
        return self.rows[:, :, :-13]

    @property
    def by_state(self) -> Array:
        """A (P, 3, 12)."""
        return self.rows[:, :, -13:-1]

    def points(self, T_world_cam: Array) -> Array:
        """Return the points (P, 3) of the landmarks in the world, if the state is at a pose."""
        return points_of(self.seen, self.views(T_world_cam))

    def only(self, keep: NDArray[np.bool_]) -> LandmarkPrior:
        """Return the prior of the landmarks that are kept (P,), of the same state and variables."""
        if keep.all():
            return self
        return replace(
            self,
            number=self.number[keep],
            seen=self.seen[keep],
            R_cam_view=self.R_cam_view[keep],
            root=self.root[keep],
            rows=self.rows[keep],
        )

    def without_error(self, rows: Array, shared: Array | None = None) -> Array:
        """Return coordinates (P, 3) in the views, given the rows at a state, and s (d,), or 0."""
        error = rows[:, :, -1] if shared is None else rows[:, :, -1] + self.by_shared @ shared
        return self.seen - np.linalg.solve(self.root, error[:, :, None])[:, :, 0]

    def with_landmarks(
        self, T_world_cam: Array, rows: Array, charts: Array, coordinates: Array
    ) -> Array:
        """Add to the rows at a state what coordinates (P, 3) in charts (P, 4, 4) do to them.

        Returned are the rows (P, 3, 3) by these landmarks.
        """
        by_landmark = np.empty((len(self), 3, 3))
        known = self.views(T_world_cam), self.R_cam_view, charts, coordinates, self.seen, self.root
        prior_system_kernel(*known, rows, by_landmark)
        return by_landmark

    def moved(self, drift: ArrayLike, camera: Camera) -> LandmarkPrior:
        """Return what is known of the landmarks after their tracks have moved on these.

        By standard deviations as in `marginalize`, pixels; those that are zero have not.

        Raises
        ------
        ValueError
            If they have another shape or are not finite.
        """
        deviation = drift_of_coordinates(drift, len(self), as_camera(camera).parameters)
        root, rows = self.root.copy(), self.rows.copy()
        some = np.flatnonzero(deviation.any(axis=1))
        spread = np.linalg.inv(root[some])
        covariance = spread @ spread.transpose(0, 2, 1) + deviation[some, :, None] ** 2 * np.eye(3)
        root[some] = np.linalg.inv(np.linalg.cholesky(covariance))
        rows[some] = root[some] @ spread @ rows[some]
        return replace(self, root=root, rows=rows)

    def views(self, T_world_cam: Array) -> Array:
        """Return the poses (P, 4, 4) of the views from a pose."""
        return views_of(T_world_cam, self.R_cam_view)

    def at(self, T_world_cam: Array, velocity: Array) -> Array:
        """Return C, A and A dx + e (P, 3, d + 12 + 1) of the state as it is now."""
        rows = self.rows.copy()
        moved_rows_kernel(self.T_world_cam, self.velocity, T_world_cam, velocity, self.rows, rows)
        return rows


def points_of(coordinates: Array, views: Array) -> Array:
    """Return the points (P, 3) of coordinates (P, 3), (x / z, y / z, 1 / z), in views (P, 4, 4)."""
    x, y, inverse_depth = coordinates.T
    local = np.column_stack([x, y, np.ones(len(x))]) / inverse_depth[:, None]
    return np.asarray(np.einsum("kij,kj->ki", views[:, :3, :3], local) + views[:, :3, 3])


def drift_of_coordinates(drift: ArrayLike, count: int, camera: Array) -> Array:
    """Return standard deviations (count, 3) of coordinates (x / z, y / z, 1 / z).

    The drift is in pixels, (3,) for all landmarks or (count, 3).
    """
    fx, fy, _, _, baseline = camera
    moved = checked_array("drift", drift, (3,)) / [fx, fy, fx * baseline]
    if moved.shape not in ((3,), (count, 3)):
        raise ValueError(
            f"drift must have three columns, for each landmark a row, not {moved.shape}"
        )
    return np.tile(moved, (count, 1)) if moved.ndim == 1 else moved


def views_of(T_world_cam: Array, R_cam_view: Array) -> Array:
    """Return the poses (P, 4, 4) of a camera's pose (4, 4) with turns (P, 3, 3)."""
    T = np.repeat(T_world_cam[None], len(R_cam_view), axis=0)
    T[:, :3, :3] = T_world_cam[:3, :3] @ R_cam_view
    return T
