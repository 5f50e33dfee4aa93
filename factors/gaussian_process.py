"""The trajectory at any time, from the states of any factor graph.

Section III-C.2 of Wang and Gammell; Barfoot, "State Estimation for Robotics", chapter 11.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_array, key_names, power_spectral_density
from factors.incremental import Incremental, joint_marginals
from factors.interpolation import InterpolatedState, extrapolate, interpolate
from factors.kernels.between import extrapolated_jacobian_kernel, state_between_kernel
from factors.kernels.compiled import kernel
from factors.kernels.matrices import copy_kernel
from factors.kernels.se3 import Array
from factors.variables import State, as_state, checked_keys, fault_of, variables_at

Index = NDArray[np.int64]
Marginals = (
    gtsam.NonlinearFactorGraph
    | gtsam.Marginals
    | gtsam.ISAM2
    | gtsam.IncrementalFixedLagSmoother
    | Incremental
)
"""What knows covariances."""


class Derivatives(NamedTuple):
    """Jacobians of states between, or beyond, border states.

    Attributes
    ----------
    border
        (...) number of the first of the two border states; the other one is the next.
    jacobian
        (..., 12, 24) of pose and twist, with respect to both border states' T_i, v_i, T_j, v_j;
        poses perturbed on the right, rotation first.
    """

    border: Index
    jacobian: Array


class GaussianProcess:
    """A WNOA trajectory through the states of a graph: pose, twist and covariance at any time.

    Before the first and after the last state the motion goes on at constant twist.

    >>> trajectory = GaussianProcess(states, values, qc, marginals=graph)
    >>> trajectory.pose(0.123), trajectory.covariance(0.123)

    Parameters
    ----------
    states
        Two or more gtsam.StateData, or tuples (pose key, velocity key, seconds), in any order.
    values
        Their Pose3 T_world_body and body twists (6,), rotation first; they are copied.
    qc
        Power spectral density of the motion prior, (6,) or (6, 6).
    marginals
        What knows the covariance of the states: gtsam.Marginals, an ISAM2 or fixed-lag smoother of
        these values; or the graph itself, which is then linearised at the values and solved by QR,
        since Marginals can fail for states that are close in time. Without, there is no covariance.

    Attributes
    ----------
    times
        (m,) seconds of the states, in order.
    keys
        Pose and velocity keys of the states, in the same order.

    Raises
    ------
    ValueError
        If there are fewer than two states, two at the same time or with the same key, or a value is
        missing or has another type or size.
    """

    def __init__(
        self,
        states: Sequence[State],
        values: gtsam.Values,
        qc: ArrayLike,
        marginals: Marginals | None = None,
    ) -> None:
        ordered = sorted((as_state("states", each) for each in states), key=lambda each: each[2])
        self.times = checked_array("states", [t for _, _, t in ordered], ())
        if len(ordered) < 2 or (np.diff(self.times) <= 0).any():
            raise ValueError("states must be two or more at different times")
        self.keys = [(pose, velocity) for pose, velocity, _ in ordered]
        variables = variables_at(ordered)
        checked_keys(variables)
        fault = fault_of(variables, values)
        if fault:
            raise ValueError(fault)
        self._T = np.array([values.atPose3(pose).matrix() for pose, _ in self.keys])
        self._v = np.array([values.atVector6(velocity) for _, velocity in self.keys])
        self._qc = power_spectral_density(qc)
        if isinstance(marginals, gtsam.NonlinearFactorGraph):
            marginals = joint_marginals(marginals, values)
        known: Any = marginals  # a smoother knows no joint covariances, but its ISAM2 does
        self._marginals: Any = known.getISAM2() if hasattr(known, "getISAM2") else known
        if not (known is None or hasattr(self._marginals, "jointMarginalCovariance")):
            raise ValueError(f"marginals must know covariances, not {type(marginals).__name__}")
        self._joint: dict[int, Array] = {}

    def __repr__(self) -> str:
        span = f"{self.times[0]:.6f} to {self.times[-1]:.6f} s"
        return f"GaussianProcess({len(self.times)} states from {span})"

    def pose(self, t: ArrayLike) -> Array:
        """Return T_world_body (..., 4, 4) at times (...), seconds."""
        return self._at(t, False).pose

    def velocity(self, t: ArrayLike) -> Array:
        """Return body twists (..., 6) at times (...), seconds; rotation first, rad/s and m/s."""
        return self._at(t, False).velocity

    def covariance(self, t: ArrayLike) -> Array:
        """Return covariances (..., 12, 12) of pose and twist at times (...), seconds.

        They are those of a right perturbation of the pose, rotation first, and of the twist. What
        rounding the joint covariance of two states dt apart loses is 4e-16 / dt^2 of them.

        Raises
        ------
        ValueError
            If no marginals were given, or they do not know a state.
        """
        if self._marginals is None:
            raise ValueError("marginals must be given for covariances")
        covariance = self._at(t, True).covariance
        assert covariance is not None
        return covariance

    def derivatives(self, t: ArrayLike) -> Derivatives:
        """Return the exact Jacobians of pose and twist at times (...) by the border states."""
        times = checked_array("t", t, ())
        border = self._border(times.ravel())
        jacobian = np.zeros((times.size, 12, 24))
        _jacobians(self._T, self._v, self.times, border, times.ravel(), jacobian)
        shape = times.shape
        return Derivatives(border.reshape(shape), jacobian.reshape(*shape, 12, 24))

    def _at(self, t: ArrayLike, with_covariance: bool) -> InterpolatedState:
        """Return the states at times (...)."""
        times = checked_array("t", t, ())
        flat = times.ravel()
        pose, velocity = np.empty((flat.size, 4, 4)), np.empty((flat.size, 6))
        covariance = np.empty((flat.size, 12, 12)) if with_covariance else None
        border, beyond = self._border(flat), (flat < self.times[0]) | (flat > self.times[-1])
        for where, found in (
            (~beyond, self._between(flat[~beyond], border[~beyond], with_covariance)),
            (beyond, self._beyond(flat[beyond], with_covariance)),
        ):
            pose[where], velocity[where] = found.pose, found.velocity
            if covariance is not None:
                covariance[where] = found.covariance
        shape = times.shape
        if covariance is not None:
            covariance = covariance.reshape(*shape, 12, 12)
        return InterpolatedState(
            pose.reshape(*shape, 4, 4), velocity.reshape(*shape, 6), covariance
        )

    def _border(self, t: Array) -> Index:
        """(n,) numbers of the states before the times, at most the last but one."""
        before = np.searchsorted(self.times, t, side="right") - 1
        return np.clip(before, 0, len(self.times) - 2).astype(np.int64)

    def _between(self, t: Array, i: Index, with_covariance: bool) -> InterpolatedState:
        joint = self._joints(i) if with_covariance else None
        ends = self._T[i], self._v[i], self._T[i + 1], self._v[i + 1]
        return interpolate(*ends, self.times[i], self.times[i + 1], t, self._qc, joint)

    def _beyond(self, t: Array, with_covariance: bool) -> InterpolatedState:
        after = t > self.times[-1]
        of_end = np.where(after, len(self.times) - 1, 0)
        covariance = None
        if with_covariance:
            joint = self._joints(self._border(t))
            covariance = np.where(after[:, None, None], joint[:, 12:, 12:], joint[:, :12, :12])
        dt = t - self.times[of_end]
        return extrapolate(self._T[of_end], self._v[of_end], dt, self._qc, covariance)

    def _joints(self, border: Index) -> Array:
        """(n, 24, 24) covariances of border states and the next ones."""
        if not len(border):
            return np.empty((0, 24, 24))
        return np.array([self._joint_of(i) for i in border.tolist()])

    def _joint_of(self, i: int) -> Array:
        """(24, 24) covariance of a state and the next one, computed once."""
        if i not in self._joint:
            keys = [*self.keys[i], *self.keys[i + 1]]
            try:
                found = self._marginals.jointMarginalCovariance(keys)
            except (RuntimeError, IndexError) as error:
                names = key_names(keys)
                raise ValueError(f"marginals have no covariance of {names}: {error}") from error
            joint = np.block([[found.at(a, b) for b in keys] for a in keys])
            self._joint[i] = self._without_fixed(joint, keys)
        return self._joint[i]

    def _without_fixed(self, joint: Array, keys: list[int]) -> Array:
        """Return the joint covariance (24, 24) of keys, zero where a Constrained noise fixes one.

        There GTSAM's is the identity, and that of the key alone is zero. Both are wrong where only
        some coordinates of a key are fixed.
        """
        if not np.isclose(np.diag(joint), 1.0).any():
            return joint
        joint = joint.copy()
        for k, key in enumerate(keys):
            if self._marginals.marginalCovariance(key).any():
                continue
            own = slice(6 * k, 6 * k + 6)
            if not np.allclose(joint[own, own], np.eye(6)):
                name = key_names([key])
                raise ValueError(
                    f"marginals have no covariance of {name}, which Constrained noise fixes in"
                    " part: give it small sigmas"
                )
            joint[own], joint[:, own] = 0.0, 0.0
        return joint


@kernel
def _jacobians(T: Array, v: Array, times: Array, border: Index, t: Array, jacobian: Array) -> None:
    """Write the Jacobians (n, 12, 24) at times (n,), see `GaussianProcess.derivatives`."""
    pose, twist, last = np.empty((4, 4)), np.empty(6), len(times) - 1
    for n in range(len(t)):
        i = border[n]
        if t[n] < times[0]:
            before = extrapolated_jacobian_kernel(v[0], t[n] - times[0])
            copy_kernel(before, jacobian[n, :, :12])
        elif t[n] > times[last]:
            after = extrapolated_jacobian_kernel(v[last], t[n] - times[last])
            copy_kernel(after, jacobian[n, :, 12:])
        else:
            a, b = t[n] - times[i], times[i + 1] - t[n]
            ends = T[i], v[i], T[i + 1], v[i + 1]
            copy_kernel(state_between_kernel(*ends, a, b, pose, twist), jacobian[n])
