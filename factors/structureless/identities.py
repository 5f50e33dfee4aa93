"""Sets of landmarks: increasing identities. For short arrays faster than numpy's set functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]


def increasing(*parts: Index) -> Index:
    """Return the identities in any of the parts, each once."""
    ordered = np.sort(np.concatenate(parts))
    first = np.ones(len(ordered), np.bool_)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    return ordered[first]


def repeated(some: Index) -> Index:
    """Return the identities that are twice or more among some (n,), each once or more."""
    ordered = np.sort(some)
    return ordered[1:][ordered[1:] == ordered[:-1]]


def are_in(known: Index, some: Index) -> NDArray[np.bool_]:
    """Tell which of some identities (n,) are among increasing ones."""
    if len(known) == 0:
        return np.zeros(len(some), np.bool_)
    place = np.minimum(np.searchsorted(known, some), len(known) - 1)
    return np.asarray(known[place] == some)
