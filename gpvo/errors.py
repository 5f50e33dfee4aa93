"""What a user's bad input raises, and what a disk does that takes no more."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, get_args


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


def require_choice(argument: str, value: object, choices: Any) -> None:
    """Raise InputError unless the value of an argument is one of a Literal's names."""
    names = get_args(choices)
    if value not in names:
        raise InputError(f"{argument} {value}: is unknown; choose one of {', '.join(names)}")


def require_type(argument: str, value: object, kind: type, maker: str) -> None:
    """Raise InputError unless the value of an argument is of a kind, which `maker` makes."""
    if not isinstance(value, kind):
        given = type(value).__name__
        raise InputError(f"{argument}: must be a {kind.__name__}, not {given}; use {maker}")
