"""Ctrl-C: the first ends the work and keeps what it gave, the second ends the program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

from gpvo.commands.cli import INTERRUPTED


class Interruption:
    """Whether Ctrl-C was pressed: `happened`."""

    happened = False


@contextmanager
def end_at_ctrl_c(end: Callable[[], None]) -> Iterator[Interruption]:
    """Call `end` at the first Ctrl-C; at a second one exit at once with status 130."""
    interruption = Interruption()

    def handle(*_: object) -> None:
        if interruption.happened:
            os._exit(INTERRUPTED)
        interruption.happened = True
        print("gpvo: ending, results follow; Ctrl-C again ends at once", file=sys.stderr)
        end()

    if current_thread() is not main_thread():  # signals go to the main thread alone
        yield interruption
        return
    before = signal.signal(signal.SIGINT, handle)
    try:
        yield interruption
    finally:
        signal.signal(signal.SIGINT, before)
