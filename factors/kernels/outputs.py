"""GTSAM's own matrices as the outputs of a kernel, by their addresses.

Each array that Python passes to a kernel costs a tenth of a microsecond, one array of all addresses
costs as much as one of them. Whoever passes addresses keeps what is there: see `Blocks`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, farray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from factors.kernels.compiled import inner_kernel
from factors.kernels.se3 import Array

Addresses = NDArray[np.uint64]


@intrinsic
def _pointer(_context: Any, address: Any) -> Any:
    """Turn an address into a pointer."""

    def code(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(address), code


@inner_kernel
def error_at(outputs: Addresses, rows: int) -> Array:
    """Return the error (rows,), which comes first."""
    return carray(_pointer(outputs[0]), (rows,), np.float64)


@inner_kernel
def jacobian_at(outputs: Addresses, k: int, rows: int, columns: int) -> Array:
    """Return the Jacobian (rows, columns) by the k-th key."""
    return farray(_pointer(outputs[1 + k]), (rows, columns), np.float64)
