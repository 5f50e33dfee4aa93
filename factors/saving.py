"""Graphs as plain numbers, texts, lists and dictionaries, for JSON or YAML.

GTSAM's own serialisation knows nothing of factors written in Python. Here a factor of ours is what
it was made with, and all else is GTSAM's own text.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import reduce
from typing import Any

import gtsam
import numpy as np

import factors
from factors.factor import Described, original

_GTSAM = "gtsam.gtsam."
_NOT_FINITE = re.compile(r"(?<!\w)-?(inf|nan)(?!\w)")


def to_dict(graph: gtsam.NonlinearFactorGraph) -> dict[str, Any]:
    """Describe a graph of factors of ours and of GTSAM's.

    Raises
    ------
    ValueError
        Naming the factor, if it holds what cannot be saved: a function, a factor written elsewhere.
    """
    described: list[Any] = []
    for number in range(graph.size()):
        factor = graph.at(number)
        try:
            described.append(_encoded(original(factor) or factor))
        except ValueError as error:
            raise ValueError(f"factor {number} cannot be saved: {error}") from None
    return {"factors": described}


def from_dict(description: Mapping[str, Any]) -> gtsam.NonlinearFactorGraph:
    """Make the graph that `to_dict` described.

    Raises
    ------
    ValueError
        If it is no such description, or an argument of a factor is wrong.
    """
    graph = gtsam.NonlinearFactorGraph()
    try:
        for described in description["factors"]:
            graph.push_back(_decoded(described))
    except (KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise ValueError(f"description must be one of to_dict: {error!r}") from error
    return graph


def _encoded(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        return {"array": value.ravel().tolist(), "shape": list(value.shape)}
    if isinstance(value, list | tuple):
        return {type(value).__name__: [_encoded(part) for part in value]}
    if isinstance(value, Described):
        return {"type": type(value).__name__, "with": _encoded_items(value._made_of)}
    if is_dataclass(value):
        named = {field.name: getattr(value, field.name) for field in fields(value)}
        return {"type": type(value).__name__, "with": _encoded_items(named)}
    name = f"{type(value).__module__}.{type(value).__qualname__}"
    if name.startswith(_GTSAM) and "serialize" in vars(type(value)):
        text = value.serialize()
        if _NOT_FINITE.search(text):
            raise ValueError(f"GTSAM cannot read what it writes of {name} with an infinite number")
        return {"gtsam": name.removeprefix(_GTSAM), "text": text}
    raise ValueError(f"{name} has no description")


def _encoded_items(items: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _encoded(value) for name, value in items.items()}


def _decoded(value: Any) -> Any:
    if not isinstance(value, Mapping):
        return value
    if "array" in value:
        return np.reshape(value["array"], value["shape"])
    if "list" in value:
        return [_decoded(part) for part in value["list"]]
    if "tuple" in value:
        return tuple(_decoded(part) for part in value["tuple"])
    if "gtsam" in value:
        kind: Any = reduce(getattr, value["gtsam"].split("."), gtsam.gtsam)
        if "__setstate__" not in vars(kind):  # that of another class would end the process
            raise ValueError(f"GTSAM makes no {value['gtsam']} of a text")
        found: Any = kind.__new__(kind)
        found.__setstate__((value["text"],))
        return found
    made: Any = getattr(factors, value["type"])
    if not (isinstance(made, type) and (issubclass(made, Described) or is_dataclass(made))):
        raise ValueError(f"factors makes no {value['type']}")
    return made(**{name: _decoded(part) for name, part in value["with"].items()})
