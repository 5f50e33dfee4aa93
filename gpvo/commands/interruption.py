"""Ctrl-C or SIGTERM: at once while packages load, then the first keeps what the work gave."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import current_thread, main_thread
from typing import Any

Handler = Callable[[int, object], None]
SIGNALS = (signal.SIGINT, signal.SIGTERM)
TERMINATED = 128 + signal.SIGTERM
"""Exit status after SIGTERM."""


class Interruption:
    """Whether the work was to end, `happened`, and the program's exit status then."""

    happened = False
    status = 0


@contextmanager
def signals_to(handler: Handler, afterwards: signal.Handlers | None = None) -> Iterator[None]:
    """Let a function handle Ctrl-C and SIGTERM; they go to the main thread alone.

    Afterwards what handled them before does again, unless something else is given.
    """
    if current_thread() is not main_thread():
        yield
        return
    before = [signal.signal(number, handler) for number in SIGNALS]
    try:
        yield
    finally:
        for number, earlier in zip(SIGNALS, before, strict=True):
            signal.signal(number, earlier if afterwards is None else afterwards)


def signals_of_the_program() -> AbstractContextManager[None]:
    """End the process at once at Ctrl-C or SIGTERM, where nothing inside handles them otherwise.

    Afterwards they are ignored: the exit status is known, and Python takes a while to end. There
    is no moment at which the system's own handling could end the process without a status.
    """
    return signals_to(_end_now, signal.SIG_IGN)


def end_at_once() -> AbstractContextManager[None]:
    """End the process at once, for the time while packages are loaded.

    An exception would come out of the package that is being initialised as another one.
    """
    return signals_to(_end_now)


def _end_now(number: int, _: object) -> None:
    os._exit(say_end(number))


@contextmanager
def end_by_exit() -> Iterator[None]:
    """End by SystemExit at Ctrl-C or SIGTERM, so that what is open is closed.

    Python ignores exceptions in generators that it deletes: the process ends at once there.
    """
    before = sys.unraisablehook

    def end(number: int, _: object) -> None:
        sys.exit(say_end(number))

    def ignored(what: Any) -> None:
        if isinstance(what.exc_value, SystemExit) and isinstance(what.exc_value.code, int):
            os._exit(what.exc_value.code)
        before(what)

    sys.unraisablehook = ignored
    try:
        with signals_to(end):
            yield
    finally:
        sys.unraisablehook = before


def say_end(number: int) -> int:
    """Say that a signal ended the program before there were results; return the exit status."""
    what = "interrupted" if number == signal.SIGINT else "terminated"
    print(f"gpvo: {what}; nothing was saved", file=sys.stderr, flush=True)
    return 128 + number


@contextmanager
def end_at_ctrl_c(
    end: Callable[[], None] = lambda: None, saved: Callable[[], str] = lambda: ""
) -> Iterator[Interruption]:
    """Call `end` at the first Ctrl-C or SIGTERM; at a second one say what is saved, and exit."""
    interruption = Interruption()

    def handle(number: int, _: object) -> None:
        status = 128 + number
        if interruption.happened:
            print(f"gpvo: ended at once; {saved()}", file=sys.stderr, flush=True)
            os._exit(status)
        interruption.happened, interruption.status = True, status
        print("gpvo: ending, results follow; Ctrl-C again ends at once", file=sys.stderr)
        end()

    with signals_to(handle):
        yield interruption
