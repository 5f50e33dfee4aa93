"""Time that numba spends on kernels before they run, whatever is done with them then.

The first run of an installation compiles them, and every process loads them: both do not depend on
the length of a recording.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Lock, get_ident

from numba.core import event

COMPILING = "numba:compile"
COMPILING_OR_LOADING = "numba:compiler_lock"


class CompilationTimer(event.Listener):  # type: ignore[misc]
    """Adds up the time in which kernels are compiled or loaded, until it is stopped.

    A kernel compiles those that it calls: their time is within its own. So is that of a thread that
    waits until another one has ended.

    Parameters
    ----------
    began
        Called when the first kernel is compiled.

    Attributes
    ----------
    seconds
        Elapsed seconds so far.
    cpu_seconds
        Processor seconds of it so far; on a busy machine they are fewer.
    """

    def __init__(self, began: Callable[[], None] = lambda: None) -> None:
        self.seconds = self.cpu_seconds = self._start = 0.0
        self._began, self._lock = began, Lock()
        self._busy: dict[int, tuple[int, float]] = {}  # depth, processor time at its begin
        for kind in (COMPILING, COMPILING_OR_LOADING):
            event.register(kind, self)
        self._listens = True

    def stop(self) -> float:
        """Stop listening, if it still does; return the seconds."""
        if self._listens:
            for kind in (COMPILING, COMPILING_OR_LOADING):
                event.unregister(kind, self)
            self._listens = False
        return self.seconds

    def elapsed(self) -> float:
        """Return the seconds so far, with those of a kernel that is not ready yet."""
        with self._lock:
            return self.seconds + (time.perf_counter() - self._start if self._busy else 0.0)

    def __enter__(self) -> CompilationTimer:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def on_start(self, event: event.Event) -> None:
        """Take the time when the outermost kernel of the first thread begins."""
        if event.kind == COMPILING:
            self._began()
            self._began = _nothing
            return
        with self._lock:
            if not self._busy:
                self._start = time.perf_counter()
            depth, begin = self._busy.get(get_ident(), (0, time.thread_time()))
            self._busy[get_ident()] = depth + 1, begin

    def on_end(self, event: event.Event) -> None:
        """Add the time when the outermost kernel of the last thread ends."""
        if event.kind == COMPILING:
            return
        with self._lock:
            depth, begin = self._busy.pop(get_ident(), (0, 0.0))
            if depth > 1:
                self._busy[get_ident()] = depth - 1, begin
            elif depth == 1:
                self.cpu_seconds += time.thread_time() - begin
            if depth == 1 and not self._busy:
                self.seconds += time.perf_counter() - self._start


def _nothing() -> None:
    """Do nothing more."""
