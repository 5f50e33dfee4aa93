"""Ctrl-C or a request to end: the first keeps what the work gave, the second ends the program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

from gpvo.commands.cli import INTERRUPTED, TERMINATED


class Interruption:
    """Whether the work was to end, `happened`, and the program's exit status then."""

    happened = False
    status = 0


@contextmanager
def end_at_ctrl_c(
    end: Callable[[], None] = lambda: None, saved: Callable[[], str] = lambda: ""
) -> Iterator[Interruption]:
    """Call `end` at the first Ctrl-C or SIGTERM; at a second one say what is saved, and exit."""
    interruption = Interruption()

    def handle(number: int, _: object) -> None:
        status = INTERRUPTED if number == signal.SIGINT else TERMINATED
        if interruption.happened:
            print(f"gpvo: ended at once; {saved()}", file=sys.stderr, flush=True)
            os._exit(status)
        interruption.happened, interruption.status = True, status
        print("gpvo: ending, results follow; Ctrl-C again ends at once", file=sys.stderr)
        end()

    if current_thread() is not main_thread():  # signals go to the main thread alone
        yield interruption
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, handle) for number in numbers]
    try:
        yield interruption
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
