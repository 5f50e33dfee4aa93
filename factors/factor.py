"""The base of all factors: what they are made of, and clear errors where they cannot be evaluated.

GTSAM keeps the error function of a factor, not its Python object. All that an optimiser does goes
through that function, so whatever has to hold there is checked in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import partial
from traceback import clear_frames
from typing import Any, SupportsFloat, SupportsIndex, SupportsInt

import gtsam
import numpy as np

from factors.checks import key_name, key_names
from factors.kernels.se3 import Array
from factors.variables import Variable, checked_keys, fault_of

Evaluate = Callable[[gtsam.Values, Any], Array]
"""Returns the error, and fills the Jacobians if there are any."""
KeyFormatter = Callable[[SupportsInt | SupportsIndex], str]
Number = SupportsFloat | SupportsIndex
_LONGEST = 160
"""Characters that are shown of one argument."""


class Described:
    """What a factor was made with, by the names of the arguments: `factor.dt`, `factor.qc`."""

    _made_of: dict[str, Any]
    keys: Callable[[], list[int]]
    noiseModel: Callable[[], gtsam.noiseModel.Base]

    def _describe(self, arguments: Mapping[str, Any]) -> None:
        """Keep what the constructor takes to make the same factor again."""
        self._made_of = {name: _own(value) for name, value in arguments.items()}

    def __getattr__(self, name: str) -> Any:
        arguments = self.__dict__.get("_made_of", {})
        if name not in arguments:
            raise AttributeError(f"{type(self).__name__} has no {name}")
        return arguments[name]

    def __setattr__(self, name: str, value: object) -> None:
        if name in self.__dict__.get("_made_of", {}):
            raise AttributeError(f"{name} of a factor does not change: make another factor")
        super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), **self._made_of), ()

    def __repr__(self, s: str = "", keyFormatter: KeyFormatter = key_name) -> str:
        keys = ", ".join(keyFormatter(key) for key in self.keys())
        noise = _noise_text(self.noiseModel())
        return f"{s}{type(self).__name__}({keys}; {self._shown()}, noise={noise})"

    def _shown(self) -> str:
        return ", ".join(f"{name}={_text(a)}" for name, a in self._made_of.items() if _is_shown(a))

    def print(self, s: str = "", keyFormatter: KeyFormatter = key_name) -> None:
        """Print type, keys, what it was made with and the noise model, after the text s."""
        keys = ", ".join(keyFormatter(key) for key in self.keys())
        model = str(self.noiseModel()).strip()
        print(f"{s}{type(self).__name__} on {keys}\n  {self._shown()}\n  noise model: {model}")

    def equals(self, other: gtsam.Factor, tol: Number = 1e-9) -> bool:
        """Return whether the other factor is of this type and made of the same, up to tol."""
        found = original(other)
        return type(found) is type(self) and _same(self._made_of, found._made_of, float(tol))


class Factor(Described, gtsam.CustomFactor):
    """A factor that says what it is, checks what it reads, and can be compared and saved.

    Parameters
    ----------
    model
        Noise model.
    variables
        What it reads, in the order of its Jacobians.
    evaluate
        The error function; it does not hold the factor.
    arguments
        What the constructor of the class takes to make the same factor again.

    Attributes
    ----------
    evaluate
        The error function, for factors that hold this one.

    Raises
    ------
    ValueError
        If the same key is given twice; and at an evaluation if a key is missing, or its value has
        another type or size. The error passes through GTSAM to the caller of an optimiser, but
        leaves an ISAM2 or a smoother that was being updated unusable. An update does not change
        types and sizes: what `check_values` accepted before it cannot fail in it.

    Notes
    -----
    GTSAM knows nothing of factors written in Python: its `clone`, `rekey`, serialisation and GNC
    optimisers raise a RuntimeError, and its `NonlinearFactorGraph.equals` compares keys and noise
    alone. Instead of these: `copy.copy` and `pickle` of a factor, `to_dict` and `from_dict` of a
    graph, `equals` of a factor, and a robust noise model.
    """

    def __init__(
        self,
        model: gtsam.noiseModel.Base,
        variables: Sequence[Variable],
        evaluate: Evaluate,
        arguments: Mapping[str, Any],
    ) -> None:
        self._describe(arguments)
        make = partial(type(self), **self._made_of)
        self.evaluate = evaluate
        variables = list(variables)
        name = type(self).__name__

        def error(
            _this: gtsam.CustomFactor,
            values: gtsam.Values,
            jacobians: gtsam.JacobianVector | None,
        ) -> Array:
            try:
                return evaluate(values, jacobians)
            except Exception as failure:
                if isinstance(values, _Question):
                    values.answer = make
                fault = fault_of(variables, values)
                # By the time that a debugger shows these frames, what GTSAM passed is gone.
                clear_frames(failure.__traceback__)
                del _this, values, jacobians
                if fault is None:
                    raise
                raise ValueError(f"{name}: {fault}") from failure

        super().__init__(model, checked_keys(variables), error)


class _Question(gtsam.Values):
    """Values that have nothing but an answer: what makes the factor that was asked."""

    answer: Callable[[], Factor] | None = None


def original(factor: gtsam.Factor | None) -> Described | None:
    """Return our object of a factor, such as of graph.at(i), or None if it is not one of ours.

    GTSAM returns a plain CustomFactor once nobody holds the object that was added; an equal one is
    then made again.
    """
    if isinstance(factor, Described):
        return factor
    if type(factor) is not gtsam.CustomFactor:
        return None
    question = _Question()
    try:
        factor.unwhitenedError(question)
    except Exception:
        if question.answer is not None:
            return question.answer()
    return None


def check_values(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
    """Check that all factors of a graph, of any kind, can be linearised at the values.

    Do it with the new factors before an update of ISAM2 or a fixed-lag smoother: an error inside an
    update would leave it unusable.

    Raises
    ------
    ValueError
        Naming the factor, its keys and what is wrong: a key that is missing, a value of another
        type or size, a number that is not finite.
    """
    for number in range(graph.size()):
        factor = graph.at(number)
        if factor is None:
            continue
        name = f"factor {number} on {key_names(factor.keys())}"
        try:
            linear = factor.linearize(values)
        except Exception as failure:
            raise ValueError(f"{name}: {failure}") from failure
        if linear is not None and not np.isfinite(linear.augmentedJacobian()).all():
            raise ValueError(f"{name}: its error or a derivative is not finite")


def _own(value: Any) -> Any:
    """Copy arrays and lists, which their owner may change later, to arrays that nobody can."""
    if isinstance(value, np.ndarray):
        value = value.copy()
        value.flags.writeable = False
    return value


def _is_shown(value: object) -> bool:
    """Tell what is not a key nor a noise model, which are printed by themselves."""
    if isinstance(value, list):
        return any(map(_is_shown, value))
    return value is not None and not isinstance(value, int | gtsam.noiseModel.Base)


def _text(value: object) -> str:
    if isinstance(value, np.ndarray):
        text = np.array2string(value, precision=6, threshold=12, max_line_width=10**6)
        return text.replace("\n", "")
    # A state, whose keys are printed before.
    if isinstance(value, tuple) and isinstance(value[-1], float):
        return f"{value[-1]:.6f} s"
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _noise_text(model: Any) -> str:
    """Return kind and sigmas of a noise model, in a line."""
    if isinstance(model, gtsam.noiseModel.Robust):
        return f"{type(model.robust()).__name__} of {_noise_text(model.noise())}"
    name = type(model).__name__
    return name if name == "Unit" else f"{name}{_text(model.sigmas())}"


def _same(a: Any, b: Any, tol: float) -> bool:
    """Compare arguments: numbers up to tol, GTSAM's objects as GTSAM does."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[name], b[name], tol) for name in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(_same(x, y, tol) for x, y in zip(a, b, strict=True))
    if isinstance(a, float | np.ndarray):
        return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=0, atol=tol)
    if is_dataclass(a):
        return _same(vars(a), vars(b), tol)
    if isinstance(a, gtsam.CustomFactor) and not isinstance(a, Described):
        return bool(a is b)  # GTSAM knows its keys and its noise alone
    if hasattr(a, "calibration") and not _same(a.calibration(), b.calibration(), tol):
        return False  # which GTSAM's stereo factor leaves out
    if hasattr(a, "equals"):
        return bool(a.equals(b, tol))
    if hasattr(a, "serialize"):
        return bool(a.serialize() == b.serialize())
    return bool(a == b)
