"""One call at a time in a second thread, while the caller goes on."""

from __future__ import annotations

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
