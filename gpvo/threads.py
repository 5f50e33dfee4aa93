"""Threads: one more for reading, none for the small matrices of the linear algebra library."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

T = TypeVar("T")


def prefetched(items: Iterator[T], ahead: int = 3) -> Iterator[T]:
    """The same items, made in a thread of its own up to some ahead of the one that is in use."""
    with ThreadPoolExecutor(1) as thread:
        coming = deque(thread.submit(next, items, None) for _ in range(ahead))
        while (item := coming.popleft().result()) is not None:
            coming.append(thread.submit(next, items, None))
            yield item


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS on one thread: the matrices are small, and several threads wait for each other."""
    return _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    """Made once numpy and scipy have loaded their libraries; looking for them takes a while."""
    return ThreadpoolController()
