"""Jacobians that kernels write into GTSAM's own matrices.

GTSAM copies a whole list of its own matrices in half a microsecond. It converts NumPy arrays one by
one, each in more than a microsecond, which would be half the time of a callback.
"""

from __future__ import annotations

from functools import lru_cache
from threading import local
from typing import Any

import gtsam
import numpy as np

from factors.kernels import Array

Jacobians = gtsam.JacobianVector | list[Any] | None
"""Where a callback writes its Jacobians: GTSAM's own list, or that of a factor that holds it."""


class JacobianBlocks(local):
    """The error and its Jacobians (rows, columns[k]) by the k-th key, for all factors of one shape.

    Fill the `error` and the `views`, then `copy_to` the list that GTSAM passes to a callback. Each
    thread has its own.
    """

    def __init__(self, rows: int, columns: tuple[int, ...]) -> None:
        self._matrices = gtsam.JacobianVector([np.zeros((rows, n), order="F") for n in columns])
        self.views: list[Array] = [self._matrices[k] for k in range(len(columns))]
        self.error: Array = np.zeros(rows)
        self.outputs = (self.error, *self.views)

    def copy_to(self, jacobians: gtsam.JacobianVector | list[Any]) -> None:
        """Copy the blocks to GTSAM's list, or to another."""
        if isinstance(jacobians, list):
            jacobians[:] = [view.copy() for view in self.views]
            return
        jacobians.clear()
        jacobians.extend(self._matrices)


def fill(jacobians: gtsam.JacobianVector | list[Any], blocks: list[Array]) -> None:
    """Write blocks (rows, columns[k]) to GTSAM's list, or to another."""
    if isinstance(jacobians, list):
        jacobians[:] = blocks
        return
    shared = _blocks_of(len(blocks[0]), tuple(block.shape[1] for block in blocks))
    for view, block in zip(shared.views, blocks, strict=True):
        view[...] = block
    shared.copy_to(jacobians)


@lru_cache(maxsize=64)
def _blocks_of(rows: int, columns: tuple[int, ...]) -> JacobianBlocks:
    return JacobianBlocks(rows, columns)
