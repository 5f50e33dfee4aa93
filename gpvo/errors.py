"""What a user's bad input raises, and what a disk does that takes no more."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """Input that cannot be used; the message names the file, the field and the remedy.

    The command line prints the message as one line and exits with status 2.
    """


class OutputError(Exception):
    """Results that cannot be written; the message names the file and what is saved.

    The command line prints the message as one line and exits with status 4.
    """


@contextmanager
def about(place: object) -> Iterator[None]:
    """Let the messages of InputError begin with a file, or a part of one."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from error
