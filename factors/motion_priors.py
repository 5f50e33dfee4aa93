"""Motion priors in any space: white noise on acceleration (WNOA) or on jerk (WNOJ).

With the local variables around state i, xi = Log(x_i^-1 x_j) and its rates w and u (see `kernels`),
the error of WNOA is [xi - dt v_i, w - v_i] and that of WNOJ [xi - dt v_i - dt^2 / 2 a_i, w - v_i -
dt a_i, u - a_i]. Barfoot, "State Estimation for Robotics", chapter 11; Tang, Yoon, Barfoot, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, overload

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from factors.checks import (
    checked_covariance,
    checked_duration,
    checked_key,
    checked_number,
    checked_numbers,
    checked_vector,
)
from factors.factor import Factor
from factors.kernels.local_variables import EXACT, FIRST_ORDER
from factors.kernels.se3 import Array
from factors.prior_error import PriorError
from factors.spaces import IN_PLANE, IN_SPACE, ROTATIONS, Space
from factors.variables import State, Variable, are_states, named_arguments
from factors.wnoa import whitening


class MotionPrior(Factor):
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
    The error of poses is whitened in the factor and its noise model is Unit; that of vectors has
    the root of its information as noise model. GTSAM 4.3 turns the covariance of short durations
    into a diagonal one, without correlation of pose and velocity. Jacobians are exact.
    """

    order: ClassVar[int]
    space: ClassVar[Space | None]
    options: ClassVar[Mapping[str, Any]] = {}
    dt: float
    qc: Array

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        made_of = self._arguments(args, kwargs)
        names = self._key_names()
        keys = [made_of[name] for name in names]
        size = len(made_of["qc"]) if self.space is None else len(self.space.columns)
        W = whitening(made_of["qc"], size)
        higher = FIRST_ORDER if made_of.get("approximate_jacobians") else EXACT
        mean = made_of.get("acceleration")
        if mean is not None:
            mean = made_of["acceleration"] = checked_vector("acceleration", mean, size)
        self._prior = PriorError(self.space, self.order, keys, made_of["dt"], W, higher, mean)
        pose, rate = self._prior.kinds
        variables = [
            Variable(name, key, pose if name.startswith("pose") else rate)
            for name, key in zip(names, keys, strict=True)
        ]
        super().__init__(self._prior.model, variables, self._prior.evaluate, made_of)

    @classmethod
    def _key_names(cls) -> list[str]:
        roles = ("pose", "velocity", "acceleration")[: cls.order]
        return [f"{role}_{end}" for end in "ij" for role in roles]

    @classmethod
    def _arguments(cls, args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
        """Check and name the arguments, whichever way they are given."""
        names = cls._key_names()
        if are_states(args, kwargs):
            given = named_arguments(("state_i", "state_j", "qc"), cls.options, args, kwargs)
            *keys_i, t_i = _parts("state_i", given.pop("state_i"), cls.order)
            *keys_j, t_j = _parts("state_j", given.pop("state_j"), cls.order)
            if not t_i < t_j:
                raise ValueError(f"state_j must be later than state_i: dt = {t_j - t_i} s")
            given |= zip(names, (*keys_i, *keys_j), strict=True)
            given["dt"] = t_j - t_i
        else:
            given = named_arguments((*names, "dt", "qc"), cls.options, args, kwargs)
        keys = {name: checked_key(name, given[name]) for name in names}
        dt, qc = checked_duration(given["dt"]), np.atleast_1d(checked_numbers("qc", given["qc"]))
        return {**keys, "dt": dt, "qc": qc, **{name: given[name] for name in cls.options}}

    def interpolate(self, values: gtsam.Values, t: float) -> tuple[Any, ...]:
        """Return pose, velocity and, for WNOJ, acceleration t seconds after state i.

        Raises
        ------
        ValueError
            If t is not within [0, dt].
        """
        if not 0 <= t <= self.dt:
            raise ValueError(f"t must be within 0 and dt = {self.dt} s, not {t}")
        return self._prior.interpolate(values, float(t))

    def covariance(self, values: gtsam.Values, t: float, joint_covariance: ArrayLike) -> Array:
        """Return the covariance (order n, order n) of what `interpolate` returns.

        `joint_covariance` (2 order n, 2 order n) is that of both states. See `factors.interpolate`
        for how exact it is.

        Raises
        ------
        ValueError
            If that is no covariance.
        """
        state = self.interpolate(values, t)
        size = 2 * self._prior.size
        joint = checked_covariance("joint_covariance", joint_covariance, size)
        return self._prior.covariance(values, state, float(t), joint)


def _parts(name: str, state: Any, order: int) -> list[Any]:
    """Return the keys of a state and its time."""
    if isinstance(state, gtsam.StateData) and order == 2:
        return [state.pose, state.velocity, state.time]
    if not (isinstance(state, tuple | list) and len(state) == order + 1):
        keys = ("pose key", "velocity key", "acceleration key")[:order]
        raise ValueError(f"{name} must be ({', '.join(keys)}, seconds), not {state!r}")
    return [*state[:-1], checked_number(f"the time of {name}", state[-1])]


class WnoaPriorFactor(MotionPrior):
    """White noise on acceleration of a gtsam.Pose3; rates are body twists, rotation first, 6.

    With `approximate_jacobians` it uses the paper's first-order E_21 and E_23 instead of the exact
    Jacobians. `acceleration` (6,), by default 0, is the mean a of the acceleration, which the white
    noise is about: the error is [xi - dt v_i - dt^2 / 2 a, w - v_i - dt a]. What lies between two
    given states is the same for any mean.
    """

    order, space = 2, IN_SPACE
    options: ClassVar[Mapping[str, Any]] = {"approximate_jacobians": False, "acceleration": None}

    @overload
    def __init__(
        self,
        pose_i: int,
        velocity_i: int,
        pose_j: int,
        velocity_j: int,
        dt: float,
        qc: ArrayLike,
        approximate_jacobians: bool = False,
        acceleration: ArrayLike | None = None,
    ) -> None: ...

    @overload
    def __init__(
        self,
        state_i: State,
        state_j: State,
        qc: ArrayLike,
        approximate_jacobians: bool = False,
        acceleration: ArrayLike | None = None,
    ) -> None: ...

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)


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
