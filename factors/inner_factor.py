"""The error and the Jacobians of any factor without its noise, for factors that hold others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import gtsam
import numpy as np

from factors.checks import checked_key, checked_numbers
from factors.factor import Evaluate, Factor, original
from factors.kernels.se3 import Array
from factors.points import PointError
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
        Called as error(None, values, jacobians), as GTSAM does. It returns the error (m,) and,
        unless jacobians is None, sets jacobians[k] to the Jacobian (m, n) with respect to the k-th
        key: of a pose perturbed on the right.
    """

    model: gtsam.noiseModel.Base
    keys: Sequence[int]
    error: Callable[[Any, gtsam.Values, Any], Array]


InnerFactor = gtsam.NoiseModelFactor | ErrorFunction


class Inner:
    """A factor without its noise.

    Attributes
    ----------
    model, keys
        Its noise model and what it reads.
    columns
        Which columns of its Jacobian are of each key, once the system was asked for; another list
        when sizes have changed.
    error
        Returns the error (m,) at values.
    system
        Returns its Jacobian, and the negative error as the last column, (m, n + 1) in Fortran's
        order, as GTSAM's augmented Jacobians are.
    """

    error: Callable[[gtsam.Values], Array]
    system: Callable[[gtsam.Values], Array]

    def __init__(self, model: gtsam.noiseModel.Base, keys: Sequence[int]) -> None:
        self.model, self.keys = model, [checked_key("inner", key) for key in keys]
        if not self.keys:
            raise ValueError("inner must have keys")
        self.columns: list[slice] = []
        self._sizes: list[int] = []

    def _place(self, sizes: list[int]) -> None:
        if sizes != self._sizes:
            ends = list(accumulate(sizes, initial=0))
            self.columns, self._sizes = list(map(slice, ends[:-1], ends[1:])), sizes


class _Native(Inner):
    """One of GTSAM's own, linearised with unit noise: what is whitened is then the error itself."""

    def __init__(self, inner: gtsam.NoiseModelFactor) -> None:
        super().__init__(inner.noiseModel(), inner.keys())
        self._unit = inner.cloneWithNewNoiseModel(gtsam.noiseModel.Unit.Create(inner.dim()))
        self._name = f"{type(inner).__name__} on {names_of(self.keys)}"

    def error(self, values: gtsam.Values) -> Array:
        try:
            return np.asarray(self._unit.unwhitenedError(values))
        except RuntimeError as failure:
            raise ValueError(f"{self._name}: {failure}") from failure

    def system(self, values: gtsam.Values) -> Array:
        try:
            found: Array = self._unit.linearize(values).augmentedJacobian()
        except RuntimeError as failure:
            raise ValueError(f"{self._name}: {failure}") from failure
        if not self.columns or found.shape[1] != self.columns[-1].stop + 1:
            zeros = values.zeroVectors()
            self._place([len(zeros.at(key)) for key in self.keys])
        return found


class _Callback(Inner):
    """An error function in Python, of a factor of ours or of the user's."""

    def __init__(
        self, model: gtsam.noiseModel.Base, keys: Sequence[int], evaluate: Evaluate
    ) -> None:
        super().__init__(model, keys)
        self._evaluate = evaluate
        self._unset = gtsam.JacobianVector([np.empty((0, 0))] * len(self.keys))
        self._shape = (model.dim(),)

    def error(self, values: gtsam.Values) -> Array:
        return self._checked(self._evaluate(values, None))

    def system(self, values: gtsam.Values) -> Array:
        jacobians = gtsam.JacobianVector(self._unset)
        error = self._checked(self._evaluate(values, jacobians))
        blocks = [jacobians[k] for k in range(len(self.keys))]
        self._place([block.shape[1] for block in blocks])
        found = np.empty((len(error), self.columns[-1].stop + 1), order="F")
        for columns, block in zip(self.columns, blocks, strict=True):
            if len(block) != len(error):
                raise ValueError(
                    "an error function must set all jacobians[k], a row for each error"
                )
            found[:, columns] = block
        np.negative(error, out=found[:, -1])
        return found

    def _checked(self, error: Array) -> Array:
        error = checked_numbers("what an error function returns", error)
        if error.shape != self._shape:
            raise ValueError(f"an error function must return {self._shape}, not {error.shape}")
        return error


def names_of(keys: Sequence[int]) -> str:
    """Return the keys as GTSAM prints them."""
    return " ".join(map(gtsam.DefaultKeyFormatter, keys))


def inner_of(inner: InnerFactor) -> Inner:
    """Return a factor of any kind without its noise.

    Raises
    ------
    ValueError
        If it is a gtsam.CustomFactor, of which GTSAM does not tell the error function, or no
        factor with a noise model.
    """
    if isinstance(inner, ErrorFunction):
        function = inner.error
        return _Callback(inner.model, inner.keys, lambda *of: function(None, *of))
    ours = original(inner) if isinstance(inner, gtsam.Factor) else None
    if isinstance(ours, Factor):
        return _Callback(ours.noiseModel(), ours.keys(), ours.evaluate)
    if isinstance(inner, gtsam.CustomFactor):
        raise ValueError("inner must not be a CustomFactor: give its parts as an ErrorFunction")
    if not isinstance(inner, gtsam.NoiseModelFactor):
        raise ValueError(f"inner must be a factor or an ErrorFunction, not {type(inner).__name__}")
    return _Native(inner)


def point_error_of(inner: InnerFactor) -> PointError | None:
    """Return the error of a factor that measures a known point alone, or None."""
    if type(inner) is gtsam.GPSFactor:
        return PointError(inner.keys()[0], np.zeros(3), np.eye(3), inner.measurementIn())
    ours = original(inner) if isinstance(inner, gtsam.Factor) else None
    error = ours.evaluate if isinstance(ours, Factor) else None
    return error if isinstance(error, PointError) else None


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
        if self._read == "atPoint3":
            to.insertPoint3(key, value)
        elif self._read in _NAMES:
            to.insert(key, **{_NAMES[self._read]: value})
        else:
            to.insert(key, value)


# The name of the argument leads GTSAM to the overload in 2 microseconds. Without it, it tries up to
# 45 of them, in 10 to 140.
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
