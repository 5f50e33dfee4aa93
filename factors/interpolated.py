"""Any factor of a pose, and of a body twist, at a time of its own between two states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from factors.checks import checked_key
from factors.factor import Evaluate, Factor
from factors.inner_factor import InnerFactor, inner_of, point_error_of
from factors.interpolated_error import Interpolation, NoiseBetween, PointInterpolation
from factors.variables import (
    ANY,
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
        The factor: one of GTSAM's, of any type; one of ours; or an ErrorFunction. Its noise model,
        which may be robust, is that of this factor.
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
        If the times are out of order or a key is not one of the inner factor's; and see `Factor`.

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
        variables = variables_of(*states)
        own = checked_keys(variables)
        pose, velocity = _keys_at_t(held.keys, own, pose, velocity)
        others = [key for key in held.keys if key not in (pose, velocity, *own)]
        variables += [Variable("of inner", key, ANY) for key in others]
        noise = None if qc is None else NoiseBetween(held.model, whitening(qc))
        keys = [variable.key for variable in variables]
        at = np.array([t - states[0][2], states[1][2] - t])
        point = None if pose is None else point_error_of(inner)
        error: Evaluate
        if point is None:
            error = Interpolation(held, keys, (pose, velocity), at, noise)
        else:
            error = PointInterpolation(point, own, at, noise)
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


def _keys_at_t(
    keys: Sequence[int], of_states: Sequence[int], pose: int | None, velocity: int | None
) -> tuple[int | None, int | None]:
    """Return which of the inner factor's keys stand for the pose and for the twist at t."""
    pose, velocity = (
        None if key is None else checked_key(role, key)
        for role, key in (("pose", pose), ("velocity", velocity))
    )
    if pose is None:
        first = next((key for key in keys if key not in of_states), keys[0])
        pose = None if first == velocity else first
    if pose is not None and pose == velocity:
        raise ValueError("pose and velocity must be different keys of the inner factor")
    for role, key in (("pose", pose), ("velocity", velocity)):
        if key is not None and key not in keys:
            raise ValueError(f"{role} must be a key of the inner factor, not {key}")
    return pose, velocity
