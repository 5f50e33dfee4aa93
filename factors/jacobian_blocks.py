"""Derivatives that kernels write into GTSAM's own matrices.

GTSAM copies a whole list of its matrices in half a microsecond, but converts arrays of NumPy one by
one in more than one each, which would be half the time of a callback.
"""

from __future__ import annotations

from threading import Lock

import gtsam
import numpy as np

from factors.kernels import Array


class JacobianBlocks:
    """Derivatives (rows, columns[k]) by the k-th key, for all factors of one shape.

    Fill the `views`, then `copy_to` what GTSAM passes to a callback, holding the `lock` all along.
    """

    def __init__(self, rows: int, columns: tuple[int, ...]) -> None:
        self.lock = Lock()
        self._matrices = gtsam.JacobianVector([np.zeros((rows, n), order="F") for n in columns])
        self.views: list[Array] = [self._matrices[k] for k in range(len(columns))]

    def copy_to(self, jacobians: gtsam.JacobianVector) -> None:
        """Hand the blocks over to GTSAM."""
        jacobians.clear()
        jacobians.extend(self._matrices)
