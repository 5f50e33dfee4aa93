"""Settings of the whole process that last while somebody needs them."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import Lock
from typing import Any

SWITCH_INTERVAL = 0.0005
"""Seconds after which a thread that waits for the interpreter takes it from the one that has it."""


class ProcessSetting:
    """A setting of the process, made while anybody in any thread is inside.

    The first one that enters makes it, and the last one that leaves takes it back, whoever that is.

    >>> with setting():
    ...     work()
    """

    def __init__(self, make: Callable[[], AbstractContextManager[Any]]) -> None:
        self._make, self._lock, self._users = make, Lock(), 0
        self._made: AbstractContextManager[Any] | None = None

    @contextmanager
    def __call__(self) -> Iterator[None]:
        """Have the setting inside."""
        self._enter()
        try:
            yield
        finally:
            self._leave()

    def _enter(self) -> None:
        with self._lock:
            self._users += 1
            if self._users == 1:
                self._made = self._make()
                self._made.__enter__()

    def _leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0 and self._made is not None:
                self._made.__exit__(None, None, None)


@contextmanager
def _short_switch_interval() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    yield
    sys.setswitchinterval(before)


quick_switches = ProcessSetting(_short_switch_interval)
"""Threads take the interpreter from each other quickly: one that returns from a kernel, which many
calls of the front end are, would wait 5 ms for it, longer than the kernel took."""


@contextmanager
def _old_objects_left_alone() -> Iterator[None]:
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


short_collections = ProcessSetting(_old_objects_left_alone)
"""Python's garbage collector leaves alone what exists now: it stops all threads for a tenth of a
second whenever it looks at all objects."""
