"""The variables that factors read, and what is wrong with those that they cannot read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import gtsam
import numpy as np

from factors.checks import checked_key, checked_number, checked_numbers, key_name
from factors.kernels.se3 import Array

State = tuple[int, int, float] | gtsam.StateData
"""Keys of the pose and the velocity, and the time in seconds."""


class Kind(NamedTuple):
    """What a variable has to be, and how it is read from values."""

    name: str
    read: Callable[[gtsam.Values, int], Any]


class Variable(NamedTuple):
    """A key, the name of the argument that gave it, and what is stored there."""

    role: str
    key: int
    kind: Kind


# They read vectors of dynamic and of fixed size, and refuse all others.
_OF_SIZE = {2: gtsam.Values.atPoint2, 3: gtsam.Values.atPoint3, 6: gtsam.Values.atVector6}


def vector(size: int) -> Kind:
    """Return the kind of vectors (size,)."""

    def read(values: gtsam.Values, key: int) -> Array:
        found: Array = values.atVector(key)
        if len(found) != size:
            raise ValueError(f"a vector of {len(found)}")
        return found

    return Kind(f"a vector of {size}", _OF_SIZE.get(size, read))


POSE3 = Kind("a Pose3", gtsam.Values.atPose3)
POSE2 = Kind("a Pose2", gtsam.Values.atPose2)
ROT3 = Kind("a Rot3", gtsam.Values.atRot3)
TWIST = vector(6)
POINT3 = Kind("a Point3", gtsam.Values.atPoint3)
BIAS = Kind("a ConstantBias", gtsam.Values.atConstantBias)
ANY = Kind("a value", gtsam.Values.exists)


def checked_keys(variables: Sequence[Variable]) -> list[int]:
    """Return the keys of variables.

    Raises
    ------
    ValueError
        If two of them are the same.
    """
    roles: dict[int, str] = {}
    for role, key, _ in variables:
        if key in roles:
            name = key_name(key)
            raise ValueError(f"{role} must not be the key of {roles[key]}, {name}")
        roles[key] = role
    return list(roles)


def fault_of(variables: Sequence[Variable], values: gtsam.Values) -> str | None:
    """Return which variable cannot be read and why, or None."""
    for role, key, kind in variables:
        name = f"{key_name(key)} ({role})"
        if not values.exists(key):
            return f"{name} is not in the values"
        try:
            kind.read(values, key)
        except (RuntimeError, ValueError):
            return f"{name} must be {kind.name}, not {_stored(values, key)}"
    return None


def _stored(values: gtsam.Values, key: int) -> str:
    """Name what is stored at a key."""
    with suppress(RuntimeError):
        return f"a vector of {len(values.atVector(key))}"
    for kind in (POSE3, POSE2, ROT3, TWIST, POINT3, BIAS):
        with suppress(RuntimeError):
            kind.read(values, key)
            return kind.name
    return "of another type"


def as_state(name: str, state: State) -> tuple[int, int, float]:
    """Return the keys of a state's pose and velocity, and its time in seconds.

    Raises
    ------
    ValueError
        If it is neither a gtsam.StateData nor such a tuple.
    """
    try:
        if isinstance(state, gtsam.StateData):
            pose, velocity, time = state.pose, state.velocity, state.time
        else:
            pose, velocity, time = state
    except (TypeError, ValueError):
        remedy = "(pose key, velocity key, seconds) or a gtsam.StateData"
        raise ValueError(f"{name} must be {remedy}, not {state!r}") from None
    keys = checked_key(name, pose), checked_key(name, velocity)
    return *keys, checked_number(f"the time of {name}", time)


def variables_of(
    state_i: tuple[int, int, float], state_j: tuple[int, int, float]
) -> list[Variable]:
    """Return pose and velocity of two states."""
    return [
        Variable(f"{role}_{end}", key, kind)
        for end, state in (("i", state_i), ("j", state_j))
        for role, key, kind in (("pose", state[0], POSE3), ("velocity", state[1], TWIST))
    ]


def variables_at(states: Sequence[tuple[int, int, float]]) -> list[Variable]:
    """Return pose and velocity of each of many states, named by their times."""
    return [
        Variable(f"{role} at {t} s", key, kind)
        for pose, velocity, t in states
        for role, key, kind in (("pose", pose, POSE3), ("velocity", velocity, TWIST))
    ]


def are_states(args: Sequence[Any], kwargs: dict[str, Any], place: int = 0) -> bool:
    """Tell whether a constructor that takes keys or states was given states, from `place` on."""
    if len(args) > place:
        return not isinstance(args[place], int | np.integer)
    return "state_i" in kwargs


def named_arguments(
    names: Sequence[str], options: Mapping[str, Any], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> dict[str, Any]:
    """Name positional arguments, the last of which are options with these defaults.

    Raises
    ------
    TypeError
        If one is missing, unknown or given twice.
    """
    every = (*names, *options)
    given = dict(zip(every, args, strict=False))
    twice, unknown = given.keys() & kwargs.keys(), kwargs.keys() - set(every)
    missing = set(names) - given.keys() - kwargs.keys()
    if len(args) > len(every) or twice or unknown or missing:
        raise TypeError(f"arguments must be {', '.join(every)}, once each")
    return {**options, **given, **kwargs}


def checked_time_between(
    t: float, state_i: tuple[int, int, float], state_j: tuple[int, int, float]
) -> float:
    """Return a time between those of two states, which are in order."""
    found, t_i, t_j = checked_numbers("t", t), state_i[2], state_j[2]
    if found.ndim or not (t_i < t_j and t_i <= found <= t_j):
        raise ValueError(f"t = {t} must lie between t_i = {t_i} and t_j = {t_j}")
    return float(found)
