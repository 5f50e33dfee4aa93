"""The continuous trajectory: states joined by the WNOA prior, evaluated at any time.

Section III-C.2 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors import extrapolate, interpolate
from factors.lie import se3_inverse
from gpvo.config import NoiseConfig
from gpvo.errors import InputError
from gpvo.npz_file import Shape, read_npz
from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.smooth_motion import velocity_scale
from gpvo.trajectory.stamped_poses import StampedPoses
from gpvo.trajectory.states import States, bracket
from gpvo.trajectory.tum import write_tum
from gpvo.trajectory.whole_file import whole_file

Array = NDArray[np.float64]

SHAPES: dict[str, Shape] = {
    "start_ns": (),
    "t": ("K",),
    "T_world_cam": ("K", 4, 4),
    "twist": ("K", 6),
    "qc": (6,),
    "knots": ("M",),
    "knot_covariance": ("M - 1", 24, 24),
    "velocity_scale": ("M",),
    "velocity_share": (),
}
"""Shapes of the arrays of a file; those of earlier versions have `velocity_share`, or neither."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Motion of the rectified left camera, in the world of its first pose or of an initial state.

    Attributes
    ----------
    start_ns
        Absolute stamp of t = 0, nanoseconds.
    t
        (K,) increasing times of the states, seconds.
    T_world_cam
        (K, 4, 4) poses of the states.
    twist
        (K, 6) body velocities of the states, rotation first, rad/s and m/s:
        T(t + dt) = T(t) Exp(dt v).
    qc
        (6,) power spectral density of the white noise on acceleration, rotation first.
    knots
        (M,) increasing indices of the states whose covariance is known.
    knot_covariance
        (M - 1, 24, 24) joint covariances of each knot and the next: pose and velocity of the first,
        then of the second. Poses are perturbed on the right, rotation first.
    velocity_scale
        (M,) what the standard deviations of the knots' velocities are multiplied by; see
        `smooth_motion` and `newest_velocity`.
    """

    start_ns: int
    t: Array
    T_world_cam: Array
    twist: Array
    qc: Array
    knots: NDArray[np.int64]
    knot_covariance: Array
    velocity_scale: Array

    @staticmethod
    def of_states(
        states: States,
        knots: CovarianceKnots,
        noise: NoiseConfig,
        velocity_scale: Array,
        start_ns: int,
        from_first: bool = True,
    ) -> Trajectory:
        """Make the trajectory of estimated states; by default the first pose becomes the world."""
        T = states.T_world_cam
        return Trajectory(
            start_ns,
            states.t,
            se3_inverse(T[0]) @ T if from_first else T,
            states.twist,
            np.array(noise.acceleration_psd),
            np.searchsorted(states.t, knots.t),
            knots.joint,
            velocity_scale,
        )

    def __len__(self) -> int:
        return len(self.t)

    @property
    def start(self) -> float:
        """Time of the first state, seconds."""
        return float(self.t[0])

    @property
    def stop(self) -> float:
        """Time of the last state, seconds."""
        return float(self.t[-1])

    def pose(self, t: ArrayLike, extrapolation: bool = False) -> Array:
        """Return T_world_cam (..., 4, 4) at times t (...), seconds.

        Raises
        ------
        InputError
            If a time is not finite, or lies outside [start, stop] without `extrapolation`.
        """
        return self._query(t, extrapolation)[0]

    def velocity(self, t: ArrayLike, extrapolation: bool = False) -> Array:
        """Return the body twist (..., 6), rotation first, at times t (...); raises like `pose`."""
        return self._query(t, extrapolation)[1]

    def covariance(self, t: ArrayLike, extrapolation: bool = False) -> Array:
        """Return the covariance (..., 12, 12) of pose and velocity at times t; raises like `pose`.

        The pose is perturbed on the right, rotation first, relative to the first pose. Between
        knots the Gaussian process interpolates, given the joint covariance of both. Velocities'
        deviations are then multiplied by `velocity_scale`, and outside [start, stop] the poses are
        uncertain by these. A single state has none: its covariance is that of the estimator's
        `latest`.
        """
        times = self._checked(t, extrapolation)
        if len(self.knots) < 2:
            raise InputError("covariance: a trajectory of one state has none; see `latest`")
        flat = times.ravel()
        knot_t = self.t[self.knots]
        inside = np.clip(flat, knot_t[0], knot_t[-1])
        before, after = bracket(knot_t, inside)
        i, j = self.knots[before], self.knots[after]
        T, twist, covariance = interpolate(
            self.T_world_cam[i],
            self.twist[i],
            self.T_world_cam[j],
            self.twist[j],
            self.t[i],
            self.t[j],
            inside,
            self.qc,
            self.knot_covariance[before],
        )
        scale = np.ones((len(flat), 12))
        scale[:, 6:] = np.interp(inside, knot_t, self.velocity_scale)[:, None]
        covariance = scale[:, :, None] * np.asarray(covariance) * scale[:, None, :]
        _, _, covariance = extrapolate(T, twist, flat - inside, self.qc, covariance)
        return np.asarray(covariance).reshape(*times.shape, 12, 12)

    def stamps_ns(self, t: ArrayLike) -> NDArray[np.int64]:
        """Return the absolute stamps (...) of times t (...), nanoseconds."""
        return self.start_ns + np.rint(np.asarray(t, np.float64) * 1e9).astype(np.int64)

    def stamped_poses(self, t: ArrayLike | None = None) -> StampedPoses:
        """Return the poses at times t (N,), by default at the states, with absolute stamps.

        A single time gives one pose.
        """
        times = self.t if t is None else np.atleast_1d(np.asarray(t, np.float64))
        return StampedPoses(self.stamps_ns(times), self.pose(times))

    def export_tum(self, path: Path | str, t: ArrayLike | None = None) -> None:
        """Write a TUM file of the poses at times t (N,), by default at the states."""
        write_tum(path, self.stamped_poses(t))

    def save(self, path: Path | str) -> None:
        """Write everything to one .npz file; an existing file is replaced by the complete one."""
        columns = {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}
        with whole_file(path) as file:
            np.savez(file, allow_pickle=False, **columns)

    @staticmethod
    def load(path: Path | str) -> Trajectory:
        """Read a trajectory that `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged or not a trajectory.
        """
        what = "a trajectory that `gpvo run` saved"
        columns = read_npz(path, what, SHAPES, optional=("velocity_scale", "velocity_share"))
        start_ns, share = int(columns.pop("start_ns")), float(columns.pop("velocity_share", 1.0))
        scale = columns.pop("velocity_scale", np.ones(len(columns["knots"])))
        loaded = Trajectory(start_ns, **columns, velocity_scale=scale)
        if not loaded._is_ordered():
            raise InputError(f"{path}: is not {what} (its times or knots are not in order)")
        if share < 1.0:
            scale = velocity_scale(loaded.t[loaded.knots], share)
            return replace(loaded, velocity_scale=scale)
        return loaded

    def _is_ordered(self) -> bool:
        """Return whether times and knots increase, and knots are states that have covariances."""
        known = len(self.knot_covariance) == max(len(self.knots) - 1, 0)
        inside = np.isin(self.knots, np.arange(len(self))).all()
        increase = (np.diff(self.t) > 0).all() and (np.diff(self.knots) > 0).all()
        return bool(known and inside and increase and len(self) and np.isfinite(self.t).all())

    def _query(self, t: ArrayLike, extrapolation: bool) -> tuple[Array, Array]:
        times = self._checked(t, extrapolation)
        states = States(self.t, self.T_world_cam, self.twist)
        T, twist = states.query(times.ravel())
        return T.reshape(*times.shape, 4, 4), twist.reshape(*times.shape, 6)

    def _checked(self, t: ArrayLike, extrapolation: bool) -> Array:
        times = np.asarray(t, np.float64)
        if not np.isfinite(times).all():
            raise InputError("t: times must be finite")
        outside = (times < self.start) | (times > self.stop)
        if outside.any() and not extrapolation:
            raise InputError(
                f"t = {times[outside].flat[0]:.6f} s lies outside the trajectory,"
                f" {self.start:.6f} to {self.stop:.6f} s; ask for it with extrapolation=True"
            )
        return times
