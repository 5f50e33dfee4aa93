"""Work in a second thread, while the caller goes on."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class SecondThread(Generic[T]):
    """Makes calls in a second thread, one after the other.

    Each result is given once, by `done` or `wait`. What a call raises is raised there.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1)
        self._call: Future[T] | None = None

    def start(self, call: Callable[..., T], *given: Any) -> None:
        """Begin a call; the result of the one before has been taken."""
        assert self._call is None
        self._call = self._thread.submit(call, *given)

    def done(self) -> Iterator[T]:
        """Yield the result of the call if it has ended, and was not given before."""
        if self._call is not None and self._call.done():
            yield from self.wait()

    def wait(self) -> Iterator[T]:
        """Yield the result of the call when it has ended, unless it was given before."""
        call, self._call = self._call, None
        if call is not None:
            yield call.result()

    def settle(self) -> None:
        """Wait until the call has ended, and leave its result to be given."""
        if self._call is not None:
            wait([self._call])


_helper = ThreadPoolExecutor(1)
FEW = 64
"""Number of items whose work takes less time than to hand half of it to another thread."""


class Begun(Generic[T]):
    """A call that is made beside the caller, by a thread that all such calls share.

    Where that is busy until the result is asked for, who asks makes the call.
    """

    def __init__(self, call: Callable[[], T]) -> None:
        self._call, self._beside = call, _helper.submit(call)

    def result(self) -> T:
        """Return what the call returns, as soon as it does; what it raises is raised here."""
        if self._beside.cancel():
            self._beside = Future()
            self._beside.set_result(self._call())
        return self._beside.result()

    def give_up(self) -> None:
        """Wait until the call has ended, unless it was not begun."""
        if not self._beside.cancel():
            wait([self._beside])


def both(first: Callable[[], T], second: Callable[[], T]) -> tuple[T, T]:
    """Make two calls that do not depend on each other at once, the second beside this thread.

    It is for calls that spend their time outside the interpreter, as kernels do.
    """
    other = Begun(second)
    try:
        return first(), other.result()
    finally:
        other.give_up()


def in_halves(work: Callable[[slice], object], count: int) -> None:
    """Do the work of `count` independent items at once, in two halves; a few items in one."""
    if count < FEW:
        work(slice(count))
        return
    half = count // 2
    both(lambda: work(slice(half)), lambda: work(slice(half, None)))


def prefetched(items: Iterator[T], ahead: int = 16) -> Iterator[T]:
    """The same items, made in a thread of its own up to some ahead of the one that is in use."""
    thread = ThreadPoolExecutor(1)
    try:
        coming = deque(thread.submit(next, items, None) for _ in range(ahead))
        while (item := coming.popleft().result()) is not None:
            coming.append(thread.submit(next, items, None))
            yield item
    finally:
        thread.shutdown(cancel_futures=True)


def _renew() -> None:
    """Begin a thread in a forked process: it has none of its parent's."""
    global _helper
    _helper = ThreadPoolExecutor(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)
