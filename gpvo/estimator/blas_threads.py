"""One thread for the small matrices of the linear algebra library."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS on one thread: the matrices are small, and several threads wait for each other."""
    return _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    """Made once numpy and scipy have loaded their libraries; looking for them takes a while."""
    return ThreadpoolController()
