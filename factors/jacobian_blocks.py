"""Jacobians that kernels write into GTSAM's own matrices.

GTSAM copies a whole list of its own matrices in half a microsecond. It converts NumPy arrays one by
one, each in more than a microsecond, which would be half the time of a callback.
"""

from __future__ import annotations

from functools import lru_cache
from threading import local

import gtsam
import numpy as np

from factors.kernels.se3 import Array

Jacobians = gtsam.JacobianVector | None
"""Where a callback writes its Jacobians, if any."""


class Blocks:
    """An error and its Jacobians (rows, columns[k]) by the k-th key.

    Fill the `error` and the `views`, or pass their addresses, `outputs`, to a kernel that does; and
    then `copy_to` GTSAM's list.
    """

    def __init__(self, rows: int, columns: tuple[int, ...]) -> None:
        self._matrices = gtsam.JacobianVector([np.zeros((rows, n), order="F") for n in columns])
        self.views: list[Array] = [self._matrices[k] for k in range(len(columns))]
        self.error: Array = np.zeros(rows)
        self.outputs = np.array([each.ctypes.data for each in (self.error, *self.views)], np.uint64)

    def copy_to(self, jacobians: gtsam.JacobianVector) -> None:
        """Copy the Jacobians to GTSAM's list."""
        jacobians.clear()
        jacobians.extend(self._matrices)


class JacobianBlocks(local):
    """The blocks of all factors of one shape; each thread has its `own`."""

    def __init__(self, rows: int, columns: tuple[int, ...]) -> None:
        self.own = Blocks(rows, columns)


@lru_cache(maxsize=64)
def blocks_of(rows: int, columns: tuple[int, ...]) -> JacobianBlocks:
    """Return the blocks of a shape."""
    return JacobianBlocks(rows, columns)
