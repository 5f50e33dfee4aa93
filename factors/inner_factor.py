"""The error and the Jacobians of any factor without its noise, for factors that hold others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import gtsam
import numpy as np

from factors.checks import checked_key, checked_numbers, key_names
from factors.factor import Evaluate, Factor, original
from factors.jacobian_blocks import Jacobians
from factors.kernels.se3 import Array
from factors.points import PointError


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


class Inner(NamedTuple):
    """A factor without its noise: the noise model, the keys, and the error with its Jacobians."""

    model: gtsam.noiseModel.Base
    keys: list[int]
    evaluate: Evaluate


def inner_of(inner: InnerFactor) -> Inner:
    """Return a factor of any kind without its noise.

    Raises
    ------
    ValueError
        If it is no factor with a noise model, or has no keys, or one twice.
    """
    evaluate: Evaluate
    if isinstance(inner, ErrorFunction):
        model, keys, ours = inner.model, inner.keys, None
    elif isinstance(inner, gtsam.NoiseModelFactor):
        model, keys, ours = inner.noiseModel(), inner.keys(), original(inner)
    else:
        raise ValueError(f"inner must be a factor or an ErrorFunction, not {type(inner).__name__}")
    if not isinstance(model, gtsam.noiseModel.Base):
        raise ValueError(f"inner must have a noise model, not {type(model).__name__}")
    if isinstance(inner, ErrorFunction):
        evaluate = _checked(partial(inner.error, None), model.dim())
    elif isinstance(ours, Factor):
        evaluate = ours.evaluate
    elif isinstance(inner, gtsam.CustomFactor):
        evaluate = _checked(inner.unwhitenedError, model.dim())
    else:
        evaluate = _native(inner)
    checked = [checked_key("inner", key) for key in keys]
    if not checked or len(set(checked)) < len(checked):
        raise ValueError(f"inner must have keys, each once, not {key_names(checked)}")
    return Inner(model, checked, evaluate)


def _checked(function: Callable[..., Any], size: int) -> Evaluate:
    """Return an error function that somebody wrote in Python, which may return anything."""

    def evaluate(values: gtsam.Values, jacobians: Jacobians) -> Array:
        error = checked_numbers("what an error function returns", function(values, jacobians))
        if error.shape != (size,):
            raise ValueError(f"an error function must return {(size,)}, not {error.shape}")
        return error

    return evaluate


def _native(inner: gtsam.NoiseModelFactor) -> Evaluate:
    """Return the error of a factor of GTSAM's, whose Jacobians it writes by itself."""
    name = f"{type(inner).__name__} on {key_names(inner.keys())}"
    error: Evaluate = inner.unwhitenedError

    def evaluate(values: gtsam.Values, jacobians: Jacobians) -> Array:
        try:
            return error(values, jacobians)
        except RuntimeError as failure:
            raise ValueError(f"{name}: {failure}") from failure

    return evaluate


def point_error_of(inner: InnerFactor) -> PointError | None:
    """Return the error of a factor that measures a known point alone, or None."""
    if type(inner) is gtsam.GPSFactor:
        return PointError(inner.keys()[0], np.zeros(3), np.eye(3), inner.measurementIn())
    ours = original(inner) if isinstance(inner, gtsam.Factor) else None
    error = ours.evaluate if isinstance(ours, Factor) else None
    return error if isinstance(error, PointError) else None
