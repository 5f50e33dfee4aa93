"""Motion priors in any space: white noise on acceleration (WNOA) or on jerk (WNOJ).

With the local variables around state i, xi = Log(x_i^-1 x_j) and its rates w and u (see `kernels`),
the error of WNOA is [xi - dt v_i, w - v_i] and that of WNOJ [xi - dt v_i - dt^2 / 2 a_i, w - v_i -
dt a_i, u - a_i]. Barfoot, "State Estimation for Robotics", chapter 11; Tang, Yoon, Barfoot, 2019.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_array, checked_duration, power_spectral_density
from factors.factor import Factor
from factors.jacobian_blocks import Jacobians, fill
from factors.kernels import EXACT, Array, local_motion_kernel, retract_motion_kernel, wnoj_kernel
from factors.kernels import quintic_weights as wnoj_weights
from factors.spaces import IN_PLANE, IN_SPACE, ROTATIONS, Space
from factors.variables import Variable, are_states, vector
from factors.wnoa import WnoaFactor, whitening, wnoa_kernel


def prior_covariance(order: int, dt: float, qc: ArrayLike, dimension: int = 6) -> Array:
    """Compute the covariance (order n, order n) of a prior's error after dt seconds.

    `order` is 2 for WNOA and 3 for WNOJ; `qc` the power spectral density, (n,) or (n, n), of the
    white noise, with n = `dimension`.
    """
    root = np.linalg.inv(information_root(order, checked_duration(dt)))
    return np.asarray(np.kron(root @ root.T, power_spectral_density(qc, dimension)), np.float64)


def prior_square_root_information(
    order: int, dt: float, qc: ArrayLike, dimension: int = 6
) -> Array:
    """Compute S (order n, order n) with SᵀS the inverse of `prior_covariance`, in closed form."""
    W = np.linalg.inv(np.linalg.cholesky(power_spectral_density(qc, dimension)))
    return np.asarray(np.kron(information_root(order, checked_duration(dt)), W), np.float64)


def information_root(order: int, dt: float) -> Array:
    """Compute the upper triangular scalars (order, order) whose Kronecker product with W is S."""
    powers = dt ** (0.5 - np.arange(order, 0, -1))
    if order == 2:
        return np.array([[2 * np.sqrt(3), -np.sqrt(3)], [0, 1]]) * powers
    five, three = np.sqrt(5), np.sqrt(3)
    return np.array([[12 * five, -6 * five, five], [0, 2 * three, -three], [0, 0, 1]]) * powers


class BetweenStates:
    """What a motion prior tells of the time between its states."""

    _error: _PriorError
    dt: float

    def interpolate(self, values: gtsam.Values, t: float) -> tuple[Any, ...]:
        """Return pose, velocity and, for WNOJ, acceleration t seconds after state i.

        Raises
        ------
        ValueError
            If t is not within [0, dt].
        """
        if not 0 <= t <= self.dt:
            raise ValueError(f"t must be within 0 and dt = {self.dt} s, not {t}")
        return self._error.interpolate(values, float(t))

    def covariance(self, values: gtsam.Values, t: float, joint_covariance: ArrayLike) -> Array:
        """Return the covariance (order n, order n) of what `interpolate` returns.

        `joint_covariance` (2 order n, 2 order n) is that of both states. See `factors.interpolate`
        for how exact it is.
        """
        state = self.interpolate(values, t)
        size = 2 * self._error.size
        joint = checked_array("joint_covariance", joint_covariance, (size, size))
        return self._error.covariance(values, state, float(t), joint)


class MotionPrior(BetweenStates, Factor):
    """Motion prior between two states that are dt seconds apart.

    It takes either the keys, `Prior(pose_i, velocity_i, pose_j, velocity_j, dt, qc)`, with an
    acceleration after each velocity for WNOJ; or the states, `Prior(state_i, state_j, qc)`: tuples
    (pose, velocity, seconds), with the acceleration before the seconds for WNOJ, or gtsam.StateData
    for WNOA.

    Parameters
    ----------
    pose_i, velocity_i, acceleration_i, pose_j, velocity_j, acceleration_j
        Keys of the variables of the space, and of vectors of its dimension: rates in the body's
        frame, in the order of GTSAM's tangent.
    dt
        Seconds from i to j, positive.
    qc
        Power spectral density of the white noise on acceleration or jerk: its diagonal, or whole.

    Raises
    ------
    ValueError
        If dt is not positive or qc is not positive definite; and see `Factor`.

    Notes
    -----
    The error is whitened in the factor and its noise model is Unit. Jacobians are exact.
    """

    order: ClassVar[int]
    space: ClassVar[Space | None]
    dt: float
    qc: Array

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        made_of = self._arguments(args, kwargs)
        *keys, dt, qc = made_of.values()
        half = len(keys) // 2
        W = np.linalg.inv(np.linalg.cholesky(_density(qc, self.space)))
        self._error = _PriorError(self.space, self.order, keys[:half], keys[half:], dt, W)
        pose, rate = self._error.kinds
        kinds = [pose if name.startswith("pose") else rate for name in made_of][: len(keys)]
        variables = [Variable(*of) for of in zip(made_of, keys, kinds, strict=False)]
        unit = gtsam.noiseModel.Unit.Create(self.order * len(W))
        super().__init__(unit, variables, self._error, made_of)

    @classmethod
    def _arguments(cls, args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
        """Check and name the arguments, whichever way they are given."""
        roles = ("pose", "velocity", "acceleration")[: cls.order]
        names = [f"{role}_{end}" for end in "ij" for role in roles]
        if are_states(args, kwargs):
            given = _named(("state_i", "state_j", "qc"), args, kwargs)
            *keys_i, t_i = _parts("state_i", given["state_i"], cls.order)
            *keys_j, t_j = _parts("state_j", given["state_j"], cls.order)
            if not t_i < t_j:
                raise ValueError(f"state_j must be later than state_i: dt = {t_j - t_i} s")
            given = dict(zip(names, (*keys_i, *keys_j), strict=True), dt=t_j - t_i, qc=given["qc"])
        else:
            given = _named((*names, "dt", "qc"), args, kwargs)
        keys = {name: int(given[name]) for name in names}
        return {
            **keys,
            "dt": checked_duration(given["dt"]),
            "qc": np.array(given["qc"], np.float64),
        }


class _PriorError:
    """Error function of a prior, and what lies between its states."""

    def __init__(
        self,
        space: Space | None,
        order: int,
        keys_i: Sequence[int],
        keys_j: Sequence[int],
        dt: float,
        W: Array,
    ) -> None:
        self._space, self._order, self._keys = space, order, (keys_i, keys_j)
        self._dt, self._W, self.size = dt, W, order * len(W)
        self._root = np.kron(information_root(order, dt), W)
        size, columns = len(W), range(len(W)) if space is None else space.columns
        width, self._columns = size if space is None else 6, np.array(columns)
        self._rows = np.concatenate([width * k + np.array(columns) for k in range(order)])
        self._picked = np.ix_(self._rows, np.r_[self._rows, width * order + self._rows])
        rate = vector(size)
        self.kinds = (rate if space is None else space.kind, rate)

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        i, j = (self._read(values, keys) for keys in self._keys)
        jacobian, error = self._linearized(i, j, self._dt)
        if jacobians is not None:
            size = len(self._W)
            whitened = self._root @ jacobian
            fill(jacobians, [whitened[:, k : k + size] for k in range(0, len(whitened[0]), size)])
        return np.asarray(self._root @ error)

    def _read(self, values: gtsam.Values, keys: Sequence[int]) -> list[Array]:
        """Return the pose as a transform, or a vector, and its rates, in the columns of SE(3)."""
        pose, rate = self.kinds
        found = pose.read(values, keys[0])
        rates = [rate.read(values, key) for key in keys[1:]]
        if self._space is None:
            return [found, *rates]
        return [self._space.to_transform(found), *map(self._spread, rates)]

    def _spread(self, rate: Array) -> Array:
        spread = np.zeros(6)
        spread[self._columns] = rate
        return spread

    def _linearized(self, i: list[Array], j: list[Array], dt: float) -> tuple[Array, Array]:
        """Return the Jacobian (order n, 2 order n) and the error (order n,), not whitened."""
        if self._space is None:
            J = np.hstack([-_transition(self._order, len(self._W), dt), np.eye(len(self._rows))])
            return J, J @ np.concatenate([*i, *j])
        whole = (
            wnoa_kernel(*i, *j, dt, True, EXACT) if self._order == 2 else wnoj_kernel(*i, *j, dt)
        )
        return whole[self._picked], whole[self._rows, -1]

    def interpolate(self, values: gtsam.Values, t: float) -> tuple[Any, ...]:
        i, j = (self._read(values, keys) for keys in self._keys)
        weights = _weights(self._order, t, self._dt - t)
        if self._space is None:
            between = np.einsum("eab,ebn->an", weights, np.stack([np.stack(i), np.stack(j)]))
            return tuple(between)
        at_j = local_motion_kernel(i[0], j[0], j[1], j[-1])[:, 24].reshape(3, 6)[: self._order]
        at_i = np.stack([np.zeros(6), *i[1:]])
        local = np.zeros(18)
        local[: 6 * self._order] = (weights[0] @ at_i + weights[1] @ at_j).ravel()
        T, v, a = np.empty((4, 4)), np.empty(6), np.empty(6)
        retract_motion_kernel(i[0], local, T, v, a)
        rates = [rate[list(self._space.columns)] for rate in (v, a)[: self._order - 1]]
        return (self._space.from_transform(T), *rates)

    def covariance(
        self, values: gtsam.Values, state: tuple[Any, ...], t: float, joint: Array
    ) -> Array:
        """Return the covariance of the state between, as one more state of the graph."""
        size, (i, j) = self.size, (self._read(values, keys) for keys in self._keys)
        if t == 0 or t == self._dt:
            own = slice(0, size) if t == 0 else slice(size, None)
            return joint[own, own]
        space = self._space
        middle = (
            list(state)
            if space is None
            else [space.to_transform(state[0]), *map(self._spread, state[1:])]
        )
        rows, others = [], np.zeros((2 * size, 2 * size))
        for n, (one, other, dt) in enumerate(((i, middle, t), (middle, j, self._dt - t))):
            S = np.kron(information_root(self._order, dt), self._W)
            J = S @ self._linearized(one, other, dt)[0]
            mine, end = (J[:, size:], J[:, :size]) if n == 0 else (J[:, :size], J[:, size:])
            rows.append(mine)
            part = slice(n * size, (n + 1) * size)
            others[part, part] = end
        Q, R = np.linalg.qr(np.vstack(rows))
        inverse = np.linalg.inv(R)
        gain = inverse @ (Q.T @ others)
        return np.asarray(gain @ joint @ gain.T + inverse @ inverse.T)


def _weights(order: int, a: float, b: float) -> Array:
    """(2, order, order) weights of both states' local variables at a after i and b before j."""
    if order == 3:
        return wnoj_weights(a, b)
    dt = a + b
    s, r = a / dt, b / dt
    at_i = [[r * r * (1 + 2 * s), r * r * a], [-6 * s * r / dt, r * (1 - 3 * s)]]
    at_j = [[s * s * (1 + 2 * r), -s * s * b], [6 * s * r / dt, s * (1 - 3 * r)]]
    return np.array([at_i, at_j])


def _transition(order: int, size: int, dt: float) -> Array:
    """(order n, order n) transition of a vector and its rates over dt."""
    powers = [[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]]
    return np.kron(np.array(powers)[:order, :order], np.eye(size))


def _named(names: Sequence[str], args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Name positional arguments.

    Raises
    ------
    TypeError
        If one is missing, unknown or given twice.
    """
    given = dict(zip(names, args, strict=False))
    twice, unknown = given.keys() & kwargs.keys(), kwargs.keys() - set(names)
    missing = set(names) - given.keys() - kwargs.keys()
    if len(args) > len(names) or twice or unknown or missing:
        raise TypeError(f"arguments must be {', '.join(names)}, once each")
    return {**given, **kwargs}


def _parts(name: str, state: Any, order: int) -> list[Any]:
    """Return the keys of a state and its time."""
    if isinstance(state, gtsam.StateData) and order == 2:
        return [state.pose, state.velocity, state.time]
    if not (isinstance(state, tuple | list) and len(state) == order + 1):
        keys = ("pose key", "velocity key", "acceleration key")[:order]
        raise ValueError(f"{name} must be ({', '.join(keys)}, seconds), not {state!r}")
    return list(state)


def _density(qc: ArrayLike, space: Space | None) -> Array:
    return power_spectral_density(qc, len(qc) if space is None else len(space.columns))  # type: ignore[arg-type]


class WnoaPriorFactor(BetweenStates, WnoaFactor):
    __doc__ = WnoaFactor.__doc__

    @property
    def _error(self) -> _PriorError:  # type: ignore[override]
        made_of = self._made_of
        keys_i, keys_j = (
            [made_of[f"{role}_{end}"] for role in ("pose", "velocity")] for end in "ij"
        )
        return _PriorError(IN_SPACE, 2, keys_i, keys_j, self.dt, whitening(self.qc))


class WnoaPriorFactorPose2(MotionPrior):
    """White noise on acceleration of a gtsam.Pose2; rates are (x, y, angle), 3."""

    order, space = 2, IN_PLANE


class WnoaPriorFactorRot3(MotionPrior):
    """White noise on acceleration of a gtsam.Rot3; rates are body rates, 3."""

    order, space = 2, ROTATIONS


class WnoaPriorFactorVector(MotionPrior):
    """White noise on acceleration of a vector of any size, that of qc."""

    order, space = 2, None


class WnojPriorFactor(MotionPrior):
    """White noise on jerk of a gtsam.Pose3; rates are body twists, rotation first, 6."""

    order, space = 3, IN_SPACE


class WnojPriorFactorPose2(MotionPrior):
    """White noise on jerk of a gtsam.Pose2; rates are (x, y, angle), 3."""

    order, space = 3, IN_PLANE


class WnojPriorFactorRot3(MotionPrior):
    """White noise on jerk of a gtsam.Rot3; rates are body rates, 3."""

    order, space = 3, ROTATIONS


class WnojPriorFactorVector(MotionPrior):
    """White noise on jerk of a vector of any size, that of qc."""

    order, space = 3, None
