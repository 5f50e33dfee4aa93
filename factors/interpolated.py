"""Any factor of a pose, and of a body twist, at a time of its own between two states."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_finite_noise
from factors.factor import Evaluate, Factor
from factors.inner_factor import ANY, CopiedValue, InnerFactor, parts_of
from factors.interpolation import root_given_states
from factors.jacobian_blocks import Jacobians, fill
from factors.kernels import Array, state_between_kernel
from factors.variables import (
    POSE3,
    TWIST,
    State,
    Variable,
    as_state,
    checked_keys,
    checked_time_between,
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
        The keys of the inner factor that stand for the pose and for the body twist at t. Its first
        key is the pose by default, unless it is the twist; none is the twist by default. Its other
        keys stay what they are.
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
    The Jacobian is exact by the chain rule, if that of the inner factor is. With qc, how the
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
        model, inner_keys, evaluate = parts_of(inner)
        if pose is None and inner_keys[0] != velocity:
            pose = inner_keys[0]
        for role, key in (("pose", pose), ("velocity", velocity)):
            if key is not None and key not in inner_keys:
                raise ValueError(f"{role} must be a key of the inner factor, not {key}")
        variables = [
            Variable(f"{role}_{end}", key, kind)
            for end, state in zip("ij", states, strict=True)
            for role, key, kind in (("pose", state[0], POSE3), ("velocity", state[1], TWIST))
        ]
        own = checked_keys(variables)
        others = [key for key in inner_keys if key not in (pose, velocity)]
        variables += [Variable("of inner", key, ANY) for key in others if key not in own]
        noise = None if qc is None else _NoiseBetween(model, whitening(qc))
        error = _Interpolation(evaluate, inner_keys, (pose, velocity), states, t, noise)
        made_of = {
            "inner": inner,
            "state_i": states[0],
            "state_j": states[1],
            "t": t,
            "pose": pose,
            "velocity": velocity,
            "qc": None if qc is None else np.array(qc, np.float64),
        }
        super().__init__(model if noise is None else noise.model, variables, error, made_of)


class _NoiseBetween:
    """Noise of a measurement between two states, to which these leave the state at t uncertain."""

    def __init__(self, model: gtsam.noiseModel.Base, W: Array) -> None:
        checked_finite_noise(model, model.dim())
        robust = model.robust() if isinstance(model, gtsam.noiseModel.Robust) else None
        gaussian = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
        unit = gtsam.noiseModel.Unit.Create(model.dim())
        self.model = unit if robust is None else gtsam.noiseModel.Robust.Create(robust, unit)
        self._covariance, self._W = gaussian.covariance(), W  # type: ignore[attr-defined]

    def whitening(
        self, ends: tuple[Array, ...], T: Array, v: Array, a: float, b: float, H: Array
    ) -> Array:
        """Return W (m, m) of errors with the Jacobian H (m, 12) by the state (T, v) at t."""
        root = H @ root_given_states(ends, T, v, a, b, self._W)
        covariance = self._covariance + root @ root.T
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


class _Interpolation:
    """Error function of an inner one at a time between two states."""

    def __init__(
        self,
        evaluate: Evaluate,
        inner_keys: list[int],
        at_t: tuple[int | None, int | None],
        states: tuple[tuple[int, int, float], ...],
        t: float,
        noise: _NoiseBetween | None,
    ) -> None:
        self._evaluate, self._keys, (self._pose, self._velocity) = evaluate, inner_keys, at_t
        self._states, self._noise = states, noise
        self._a, self._b = t - states[0][2], states[1][2] - t
        self._others = {key: CopiedValue() for key in inner_keys if key not in at_t}

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        (pose_i, velocity_i, _), (pose_j, velocity_j, _) = self._states
        ends = (
            values.atPose3(pose_i).matrix(),
            values.atVector6(velocity_i),
            values.atPose3(pose_j).matrix(),
            values.atVector6(velocity_j),
        )
        T, v = np.empty((4, 4)), np.empty(6)
        by_ends = state_between_kernel(*ends, self._a, self._b, T, v)
        inner = self._values_at(values, T, v)
        if jacobians is None and self._noise is None:
            return self._evaluate(inner, None)
        blocks: list[Any] = [None] * len(self._keys)
        error = self._evaluate(inner, blocks)
        by_key = dict(zip(self._keys, blocks, strict=True))
        by_state = np.zeros((len(error), 12))
        if self._pose is not None:
            by_state[:, :6] = by_key.pop(self._pose)
        if self._velocity is not None:
            by_state[:, 6:] = by_key.pop(self._velocity)
        if self._noise is not None:
            W = self._noise.whitening(ends, T, v, self._a, self._b, by_state)
            error, by_state = W @ error, W @ by_state
            by_key = {key: W @ block for key, block in by_key.items()}
        if jacobians is not None:
            by_states = by_state @ by_ends
            keys = pose_i, velocity_i, pose_j, velocity_j
            by_outer = {key: by_states[:, 6 * k : 6 * k + 6] for k, key in enumerate(keys)}
            for key, block in by_key.items():  # a state may also be one of the inner factor's own
                by_outer[key] = by_outer[key] + block if key in by_outer else block
            fill(jacobians, list(by_outer.values()))
        return error

    def _values_at(self, values: gtsam.Values, T: Array, v: Array) -> gtsam.Values:
        """Return the values of the inner factor, the state at t among them."""
        found = gtsam.Values()
        if self._pose is not None:
            found.insert(self._pose, pose3=gtsam.Pose3(T))  # by name: see CopiedValue
        if self._velocity is not None:
            found.insert(self._velocity, vector=v)
        for key, copied in self._others.items():
            copied.copy(values, key, found)
        return found
