"""How kernels are compiled by numba, here and in packages that are built on this one.

Compilation delays the first run. Wrappers that nobody calls are therefore left out, and divisions
by zero give infinity as in numpy, so that no error is compiled for them. No kernel assigns an array
or a tuple to a part of another: the message that they do not fit, `a[i] = b`, takes seconds.
"""

from __future__ import annotations

from typing import Any

from numba import njit

KERNEL: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "nogil": True,
}
kernel = njit(**KERNEL)

_INNER: dict[str, Any] = {**KERNEL, "no_cpython_wrapper": True}
"""Of those that are called by kernels only."""
inner_kernel = njit(**_INNER, forceinline=True)
# One that makes no array, and calls none that does, need not count who holds the arrays it is
# given; that takes longer than what most of these compute.
bare_kernel = njit(**_INNER, forceinline=True, _nrt=False)

_FAST = {"reassoc", "contract", "nsz"}
"""Sums may be made in any order."""
# Each caller has its own copy of what it calls, and a process takes the copy that it loads first.
# Copies are optimised where they are, so that their sums have other last bits. A kernel that is
# inlined has one order in each caller, in every process. So must be what lies between: inner ones,
# and those that are called by others, too.
fast_kernel = njit(**KERNEL, forceinline=True, fastmath=_FAST)
inlined_kernel = njit(**KERNEL, forceinline=True)


def require_cache() -> None:
    """Raise RuntimeError with the remedy if there is no folder to keep what is compiled in."""
    try:
        kernel(_nothing)
    except RuntimeError as error:
        raise RuntimeError(
            "what is compiled cannot be kept beside the sources or in the home folder; set"
            " NUMBA_CACHE_DIR to a folder that can be written"
        ) from error


def _nothing() -> None:
    """Nothing to compile."""


require_cache()
