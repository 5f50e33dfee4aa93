"""Jacobians that kernels write into GTSAM's own matrices.

GTSAM copies a whole list of its own matrices in half a microsecond. It converts NumPy arrays one by
one, each in more than a microsecond, which would be half the time of a callback.
"""

from __future__ import annotations

from threading import Lock

import gtsam
import numpy as np

from factors.kernels import Array


class JacobianBlocks:
    """Jacobians (rows, columns[k]) with respect to the k-th key, for all factors of one shape.

    Fill the `views`, then `copy_to` the list that GTSAM passes to a callback, and hold the `lock`
    while doing both.
    """

    def __init__(self, rows: int, columns: tuple[int, ...]) -> None:
        self.lock = Lock()
        self._matrices = gtsam.JacobianVector([np.zeros((rows, n), order="F") for n in columns])
        self.views: list[Array] = [self._matrices[k] for k in range(len(columns))]

    def copy_to(self, jacobians: gtsam.JacobianVector) -> None:
        """Copy the blocks to GTSAM's list."""
        jacobians.clear()
        jacobians.extend(self._matrices)
