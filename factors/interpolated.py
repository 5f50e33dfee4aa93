"""Any factor of a pose, and of a body twist, at a time of its own between two states."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_finite_noise, checked_key
from factors.factor import Evaluate, Factor
from factors.inner_factor import (
    ANY,
    CopiedValue,
    Inner,
    InnerFactor,
    inner_of,
    point_error_of,
)
from factors.jacobian_blocks import Jacobians, blocks_of
from factors.kernels.between import chain_kernel, state_at_kernel, whiten_between_kernel
from factors.kernels.points import point_between_kernel
from factors.kernels.se3 import Array
from factors.points import PointError
from factors.variables import (
    State,
    Variable,
    as_state,
    checked_keys,
    checked_time_between,
    variables_of,
)
from factors.wnoa import whitening


class InterpolatedFactor(Factor):
    """A factor of the pose at a time t between two states of a WNOA trajectory.

    >>> gps = gtsam.GPSFactor(0, position, noise)  # 0 stands for the pose at t
    >>> graph.add(InterpolatedFactor(gps, state_i, state_j, t))

    Parameters
    ----------
    inner
        The factor: one of GTSAM's own, of any type; one of ours; or an ErrorFunction. Its noise
        model, which may be robust, is that of this factor.
    state_i, state_j
        gtsam.StateData, or tuples (pose key, velocity key, seconds): Pose3 T_world_body and body
        twists (6,), rotation first.
    t
        Seconds, t_i <= t <= t_j and t_i < t_j.
    pose, velocity
        The keys of the inner factor that stand for the pose and for the body twist at t. By default
        the pose is its first key that is not of a state, unless it is the twist; none is the twist.
        Its other keys stay what they are.
    qc
        Power spectral density of the motion prior, (6,) or (6, 6). If it is given, the noise also
        has the covariance of the state at t, given both states. Without, the state at t is their
        interpolation, as of a motion that the prior expects.

    Raises
    ------
    ValueError
        If the times are out of order, a key is not one of the inner factor's, or the inner factor
        is a gtsam.CustomFactor; and see `Factor`.

    Notes
    -----
    The Jacobian is exact by the chain rule, if that of the inner factor is: that of GTSAM's
    BearingFactor is at a small error only. With qc, how the
    covariance at t changes with the states is neglected, as GTSAM does.
    """

    t: float

    def __init__(
        self,
        inner: InnerFactor,
        state_i: State,
        state_j: State,
        t: float,
        pose: int | None = None,
        velocity: int | None = None,
        qc: ArrayLike | None = None,
    ) -> None:
        states = as_state("state_i", state_i), as_state("state_j", state_j)
        t = checked_time_between(t, *states)
        held = inner_of(inner)
        pose, velocity = (
            None if key is None else checked_key(role, key)
            for role, key in (("pose", pose), ("velocity", velocity))
        )
        if pose is None:
            of_states = {key for state in states for key in state[:2]}
            first = next((key for key in held.keys if key not in of_states), held.keys[0])
            pose = None if first == velocity else first
        if pose is not None and pose == velocity:
            raise ValueError("pose and velocity must be different keys of the inner factor")
        for role, key in (("pose", pose), ("velocity", velocity)):
            if key is not None and key not in held.keys:
                raise ValueError(f"{role} must be a key of the inner factor, not {key}")
        variables = variables_of(*states)
        own = checked_keys(variables)
        others = [key for key in held.keys if key not in (pose, velocity, *own)]
        variables += [Variable("of inner", key, ANY) for key in others]
        noise = None if qc is None else _NoiseBetween(held.model, whitening(qc))
        keys = [variable.key for variable in variables]
        at = np.array([t - states[0][2], states[1][2] - t])
        point = None if pose is None else point_error_of(inner)
        error: Evaluate
        if point is None:
            error = _Interpolation(held, keys, (pose, velocity), at, noise)
        else:
            error = _PointInterpolation(point, own, at, noise)
        made_of = {
            "inner": inner,
            "state_i": states[0],
            "state_j": states[1],
            "t": t,
            "pose": pose,
            "velocity": velocity,
            "qc": None if qc is None else np.array(qc, np.float64),
        }
        super().__init__(held.model if noise is None else noise.model, variables, error, made_of)


class _NoiseBetween:
    """Noise of a measurement between two states, to which these leave the state at t uncertain.

    Attributes
    ----------
    model
        Of the whitened error.
    parts
        The covariance (m, m) of the measurement, and the `whitening` (6, 6) of the power spectral
        density.
    """

    def __init__(self, model: gtsam.noiseModel.Base, W: Array) -> None:
        checked_finite_noise(model, model.dim())
        gaussian: Any = model
        self.model: gtsam.noiseModel.Base = gtsam.noiseModel.Unit.Create(model.dim())
        if isinstance(model, gtsam.noiseModel.Robust):
            gaussian = model.noise()
            self.model = gtsam.noiseModel.Robust.Create(model.robust(), self.model)
        self.parts = np.ascontiguousarray(gaussian.covariance()), W


class _PointInterpolation:
    """Error function of a measured point at a time between two states: all in one kernel."""

    def __init__(
        self, point: PointError, keys: list[int], t: Array, noise: _NoiseBetween | None
    ) -> None:
        self._keys, m = keys, len(point.lines)
        root = (np.empty((0, 0)), np.empty((0, 0))) if noise is None else noise.parts
        self._constants = t, point.point, point.lines, *root
        self._blocks = blocks_of(m, (6, 6, 6, 6))

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        pose_i, velocity_i, pose_j, velocity_j = self._keys
        own = self._blocks.own
        point_between_kernel(
            values.atPose3(pose_i).matrix(),
            values.atVector6(velocity_i),
            values.atPose3(pose_j).matrix(),
            values.atVector6(velocity_j),
            *self._constants,
            own.outputs,
        )
        if jacobians is not None:
            own.copy_to(jacobians)
        return own.error


class _Interpolation:
    """Error function of an inner one at a time between two states."""

    def __init__(
        self,
        inner: Inner,
        keys: list[int],
        at_t: tuple[int | None, int | None],
        t: Array,
        noise: _NoiseBetween | None,
    ) -> None:
        self._inner, self._keys, self._t, self._noise = inner, keys, t, noise
        self._pose, self._velocity = at_t
        self._copied = [(key, CopiedValue()) for key in inner.keys if key not in at_t]
        self._columns: list[slice] | None = None
        self._identity = gtsam.Values()
        if self._pose is not None:
            self._identity.insert(self._pose, gtsam.Pose3())
        if self._velocity is not None:
            self._identity.insert(self._velocity, np.zeros(6))

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        pose_i, velocity_i, pose_j, velocity_j = self._keys[:4]
        ends = (
            values.atPose3(pose_i).matrix(),
            values.atVector6(velocity_i),
            values.atPose3(pose_j).matrix(),
            values.atVector6(velocity_j),
        )
        found, xi = np.empty(48), np.empty(6)
        state_at_kernel(*ends, self._t, found, xi)
        at_t = self._values_at(values, xi, found[:6])
        if jacobians is None and self._noise is None:
            return self._inner.error(at_t)
        system = self._inner.system(at_t)
        if self._columns is not self._inner.columns:
            self._prepare(len(system))
        if self._noise is not None:
            noise = self._noise.parts
            whiten_between_kernel(*ends, self._t, *noise, self._places, found, system)
        blocks = self._blocks.own
        chain_kernel(ends[3], self._t, found, system, self._places, blocks.outputs)
        for place, columns in self._others:  # a state may also be one of the inner factor's own
            if place < 4:
                blocks.views[place][...] += system[:, columns]
            else:
                blocks.views[place][...] = system[:, columns]
        if jacobians is not None:
            blocks.copy_to(jacobians)
        return blocks.error

    def _prepare(self, rows: int) -> None:
        """Find out where the columns of the inner factor are, whose sizes are known by now."""
        columns = self._inner.columns
        by_key = dict(zip(self._inner.keys, columns, strict=True))
        for name, key in (("pose", self._pose), ("velocity", self._velocity)):
            if key is not None and by_key[key].stop - by_key[key].start != 6:
                raise ValueError(f"the inner Jacobian by the {name} must have 6 columns")
        firsts = (-1 if key is None else by_key[key].start for key in (self._pose, self._velocity))
        self._places = np.array(list(firsts))
        self._others = [(self._keys.index(key), by_key[key]) for key, _ in self._copied]
        sizes = {self._keys[place]: of.stop - of.start for place, of in self._others}
        self._blocks = blocks_of(rows, tuple(sizes.get(key, 6) for key in self._keys))
        self._columns = columns

    def _values_at(self, values: gtsam.Values, xi: Array, twist: Array) -> gtsam.Values:
        """Return the values of the inner factor, the state at t among them.

        It is retracted from the identity, because GTSAM looks for the `insert` of a Pose3 among 45
        of them, for longer than all else takes.
        """
        step = gtsam.VectorValues()
        if self._pose is not None:
            step.insert(self._pose, xi)
        if self._velocity is not None:
            step.insert(self._velocity, twist)
        found = self._identity.retract(step)
        for key, copied in self._copied:
            copied.copy(values, key, found)
        return found
