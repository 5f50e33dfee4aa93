"""The functions of libdeflate for kernels, which unpack many chunks in one call.

Each call from Python gives the interpreter to another thread, and waits to have it back.
"""

from __future__ import annotations

import deflate._deflate
import llvmlite.binding as llvm
import numpy as np
from numba import types
from numpy.typing import NDArray

from factors.kernels.compiled import kernel

llvm.load_library_permanently(deflate._deflate.__file__)

IS_THERE = llvm.address_of_symbol("libdeflate_zlib_decompress") is not None
"""Whether the library gives its functions to others, as on Linux; else no kernel may call them."""

_POINTER = _SIZE = types.uintp
new_decompressor = types.ExternalFunction("libdeflate_alloc_decompressor", _POINTER())
free_decompressor = types.ExternalFunction("libdeflate_free_decompressor", types.void(_POINTER))
_unpack = types.ExternalFunction(
    "libdeflate_zlib_decompress",
    types.intc(_POINTER, _POINTER, _SIZE, _POINTER, _SIZE, _POINTER),
)


@kernel
def unpack(decompressor: int, packed: NDArray[np.uint8], data: NDArray[np.uint8]) -> bool:
    """Fill `data` with what is packed by zlib; return False if that is damaged, less or more."""
    given = packed.ctypes.data, packed.size
    return bool(_unpack(decompressor, *given, data.ctypes.data, data.size, 0) == 0)
