"""The error and the Jacobians of any factor without its noise, for factors that hold others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np

from factors.factor import Evaluate, Factor, original
from factors.kernels import Array
from factors.variables import Kind


class ErrorFunction(NamedTuple):
    """An error function of your own, with what gtsam.CustomFactor takes to make a factor of it.

    Attributes
    ----------
    model
        Noise model of the error.
    keys
        What it reads.
    error
        Called as error(None, values, jacobians). It returns the error (m,) and, unless jacobians is
        None, sets jacobians[k] to the Jacobian (m, n) with respect to the k-th key: of a pose
        perturbed on the right.
    """

    model: gtsam.noiseModel.Base
    keys: Sequence[int]
    error: Callable[[Any, gtsam.Values, list[Array] | None], Array]


InnerFactor = gtsam.NoiseModelFactor | ErrorFunction


def parts_of(inner: InnerFactor) -> tuple[gtsam.noiseModel.Base, list[int], Evaluate]:
    """Return the noise model, the keys and the error function of a factor of any kind.

    Raises
    ------
    ValueError
        If it is a gtsam.CustomFactor, of which GTSAM does not tell the error function, or no
        factor with a noise model.
    """
    if isinstance(inner, ErrorFunction):
        return inner.model, [int(key) for key in inner.keys], _of_function(inner.error)
    ours = original(inner) if isinstance(inner, gtsam.Factor) else None
    if isinstance(ours, Factor):
        return ours.noiseModel(), list(ours.keys()), ours.evaluate
    if isinstance(inner, gtsam.CustomFactor):
        raise ValueError("inner must not be a CustomFactor: give its parts as an ErrorFunction")
    if not isinstance(inner, gtsam.NoiseModelFactor):
        raise ValueError(f"inner must be a factor or an ErrorFunction, not {type(inner).__name__}")
    return inner.noiseModel(), list(inner.keys()), _of_native(inner)


def _of_function(error: Callable[[Any, gtsam.Values, Any], Array]) -> Evaluate:
    def evaluate(values: gtsam.Values, jacobians: Any) -> Array:
        found = np.asarray(error(None, values, jacobians), np.float64)
        if jacobians is not None and any(block is None for block in jacobians):
            raise ValueError("an error function must set all jacobians[k]")
        return found

    return evaluate


def _of_native(inner: gtsam.NoiseModelFactor) -> Evaluate:
    """Linearise with unit noise: what is whitened is then the error itself."""
    unit = inner.cloneWithNewNoiseModel(gtsam.noiseModel.Unit.Create(inner.dim()))
    keys = list(inner.keys())
    name = f"{type(inner).__name__} on {' '.join(map(gtsam.DefaultKeyFormatter, keys))}"
    columns: list[slice] = []  # of each key, once the sizes of the values are known

    def evaluate(values: gtsam.Values, jacobians: Any) -> Array:
        try:
            if jacobians is None:
                return np.asarray(unit.unwhitenedError(values))
            A, b = unit.linearize(values).jacobian()
        except RuntimeError as failure:
            raise ValueError(f"{name}: {failure}") from failure
        if not columns:
            zeros = values.zeroVectors()
            ends = np.cumsum([0, *(len(zeros.at(key)) for key in keys)]).tolist()
            columns.extend(map(slice, ends[:-1], ends[1:]))
        jacobians[:] = [A[:, of_key] for of_key in columns]
        return -b

    return evaluate


class CopiedValue:
    """Copies the value at a key from values to others, whatever its type."""

    def __init__(self) -> None:
        self._read = "atVector"

    def read(self, values: gtsam.Values, key: int) -> Any:
        """Read the value; its type is found out once."""
        for name in (self._read, *_READERS):
            try:
                found = getattr(values, name)(key)
            except RuntimeError:
                continue
            self._read = name
            return found
        raise ValueError("a value of a type that GTSAM cannot read in Python")

    def copy(self, values: gtsam.Values, key: int, to: gtsam.Values) -> None:
        """Copy the value at the key."""
        value = self.read(values, key)
        if self._read in _NAMES:
            to.insert(key, **{_NAMES[self._read]: value})
        else:
            to.insert(key, value)


# The name of the argument leads GTSAM to the overload at once. Without it, it tries up to 45 of
# them, in 10 to 140 microseconds.
_NAMES = {
    "atPose3": "pose3",
    "atVector": "vector",
    "atPoint3": "point3",
    "atPose2": "pose2",
    "atRot3": "rot3",
    "atConstantBias": "constant_bias",
}
_READERS = [*_NAMES, *(name for name in vars(gtsam.Values) if name.startswith("at"))]
ANY = Kind("a value that GTSAM can read in Python", lambda *of: CopiedValue().read(*of))
