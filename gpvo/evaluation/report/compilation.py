"""Time that numba spends on compiling, which the first run of an installation pays once."""

from __future__ import annotations

import time
from collections.abc import Callable

from numba.core import event

KIND = "numba:compile"


class CompilationTimer(event.Listener):  # type: ignore[misc]
    """Adds up the time in which functions are compiled, from when it is made until it is stopped.

    What is loaded from a cache does not count. A function compiles those that it calls: their time
    is within its own.

    Parameters
    ----------
    began
        Called when the first function is compiled.

    Attributes
    ----------
    seconds
        Elapsed seconds so far.
    cpu_seconds
        Processor seconds so far; on a busy machine they are fewer.
    """

    def __init__(self, began: Callable[[], None] = lambda: None) -> None:
        self.seconds = self.cpu_seconds = 0.0
        self._began, self._depth, self._start, self._cpu_start = began, 0, 0.0, 0.0
        event.register(KIND, self)
        self._listens = True

    def stop(self) -> float:
        """Stop listening, if it still does; return the seconds."""
        if self._listens:
            event.unregister(KIND, self)
            self._listens = False
        return self.seconds

    def __enter__(self) -> CompilationTimer:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def on_start(self, event: event.Event) -> None:
        """Take the time when the outermost function begins; numba holds its lock meanwhile."""
        if self._depth == 0:
            self._start, self._cpu_start = time.perf_counter(), time.process_time()
            self._began()
            self._began = _nothing
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Add the time when the outermost function ends."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._start
            self.cpu_seconds += time.process_time() - self._cpu_start


def _nothing() -> None:
    """Do nothing more."""
