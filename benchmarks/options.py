"""Numbers in the options of benchmarks: others than these measure nothing, or for ever."""

from __future__ import annotations

from argparse import ArgumentTypeError
from math import isfinite


def positive(text: str) -> float:
    """Read a positive, finite number."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not (number > 0.0 and isfinite(number)):
        raise ArgumentTypeError(f"{text}: give a positive number")
    return number


def at_least_one(text: str) -> int:
    """Read a whole number of 1 or more."""
    if not (text.isdecimal() and int(text)):
        raise ArgumentTypeError(f"{text}: give 1 or more")
    return int(text)


def zero_or_more(text: str) -> int:
    """Read a whole number of 0 or more, such as a seed."""
    if not text.isdecimal():
        raise ArgumentTypeError(f"{text}: give 0 or more")
    return int(text)


def size(text: str) -> tuple[int, int]:
    """Read (width, height) in pixels."""
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise ArgumentTypeError(f"{text}: give WIDTHxHEIGHT, such as 346x260")
    return int(width), int(height)


def positives(text: str) -> list[float]:
    """Read positive numbers between commas."""
    return [positive(part) for part in text.split(",")]
