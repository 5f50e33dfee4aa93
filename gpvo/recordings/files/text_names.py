"""Names of the columns of a text file of events, and units in them."""

from __future__ import annotations

import re

from gpvo.errors import InputError

NAMES = {
    "t": r"t|ts|times?|timestamps?|stamps?|secs?|seconds",
    "nanoseconds": r"nsecs?|nanosecs?|nanoseconds?",
    "x": r"xs?|column",
    "y": r"ys?|row",
    "polarity": r"ps?|pol|polarity|polarities|sign",
    "camera": r"cam|camera|cameraid|cameraindex|camid|side|sensor",
}
UNITS = {
    "s": r"s|secs?|seconds?",
    "ms": r"ms|msecs?|milliseconds?",
    "us": r"us|µs|usecs?|microseconds?",
    "ns": r"ns|nsecs?|nanoseconds?",
}
NEEDED = ("t", "x", "y", "polarity")
REMEDY = "name them in a first line, as `# t[us] x y polarity`"


def named_columns(line: str, width: int, where: str) -> tuple[dict[str, int], str]:
    """Find the columns that a line of names states, and the unit of times.

    Parameters
    ----------
    width
        Number of columns; a line with another number of words names none.
    where
        Start of the message.

    Returns
    -------
    (columns, unit)
        Number of each column by its meaning, one of NAMES; s, ms, us, ns or empty. Both are empty
        for a line of other words.

    Raises
    ------
    InputError
        If t, x, y or polarity is missing beside others, or something is named twice.
    """
    line = re.sub(r"\s*([\[(].*?[\])])", r"\1", line.lower()).lstrip("#%/ ")
    words = [word for word in re.split(r"[\s,;|]+", line) if word]
    meanings = [_meaning(word) for word in words]
    known = [name for name, _ in meanings if name]
    if len(words) != width or len(known) < len(NEEDED) - 1:
        return {}, ""
    columns = {name: number for number, (name, _) in enumerate(meanings) if name}
    if "t" not in columns and "nanoseconds" in columns:
        columns["t"] = columns.pop("nanoseconds")
    twice = [name for name in columns if known.count(name) > 1]
    missing = [name for name in NEEDED if name not in columns]
    if twice or missing:
        problem = f"two columns are named {twice[0]}" if twice else f"no column is {missing[0]}"
        raise InputError(f"{where}: {problem} in `{line.strip()}`; {REMEDY}")
    return columns, meanings[columns["t"]][1]


def stated_size(line: str) -> tuple[int, int] | None:
    """Find (width, height) in a line of two numbers, or one like `%geometry:1280,720`."""
    pattern = r"(?:[%#]?\s*geometry\s*:?\s*)?(\d+)[\s,x]+(\d+)"
    found = re.fullmatch(pattern, line.strip().lower())
    return (int(found.group(1)), int(found.group(2))) if found else None


def _meaning(word: str) -> tuple[str, str]:
    """Return the meaning of a column's name and the unit in it; each may be empty."""
    first, *rest = re.findall(r"[a-zµ]+", word) or [""]
    last = rest[-1] if rest else first
    unit = next((unit for unit, names in UNITS.items() if re.fullmatch(names, last)), "")
    for name, pattern in NAMES.items():
        if re.fullmatch(pattern, first) or re.fullmatch(pattern, first + "".join(rest)):
            return name, unit
    return "", ""
