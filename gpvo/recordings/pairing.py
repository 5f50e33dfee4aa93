"""Find the streams of the left and the right camera by their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from gpvo.errors import InputError

SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("master", "slave"))
NUMBERED = (("0", "1"), ("1", "2"))
NO_CAMERA = "none"
"""What --right-topic names where only one camera is to be read."""

SIDE_WORDS = {word for words in SIDES for word in words}
_CAMERA = r"((?:cam|camera|dvs|davis|events?|sensor)_?)"
FILE_WORDS = [
    *((left, right, True) for left, right in SIDES),
    *((right, left, False) for left, right in SIDES),
    (_CAMERA + r"0(?!\d)", r"\g<1>1", True),
    (_CAMERA + r"1(?!\d)", r"\g<1>0", False),
]
"""Pattern in a file's name, its replacement for the other camera, and whether the file with the
pattern is the left camera's. Bare numbers are left out, as they may count recordings."""


class OneCameraError(InputError):
    """Two cameras are needed, and there is one."""


def counterparts(name: str) -> list[str]:
    """Return names that the right camera may have if `name` is the left one's, likeliest first."""
    names = []
    for left, right in SIDES:
        if left in name:
            names.append(name.replace(left, right))
            head, _, tail = name.rpartition(left)
            names.append(head + right + tail)
    for left, right in NUMBERED:
        for found in reversed(list(re.finditer(rf"(?<!\d){left}(?!\d)", name))):
            names.append(name[: found.start()] + right + name[found.end() :])
    return list(dict.fromkeys(names))


def pair(names: Sequence[str]) -> tuple[str, str] | None:
    """Return the only pair of left and right names, or None if there are no or several pairs."""
    known = set(names)
    for sides in (True, False):
        pairs = [
            (name, other)
            for name in names
            for other in counterparts(name)
            if other in known and (_has_side(name) == sides)
        ]
        if pairs:
            return pairs[0] if len(set(pairs)) == 1 else None
    return None


def _has_side(name: str) -> bool:
    return any(left in name for left, _ in SIDES)


def choose_pair(
    path: Path, names: Sequence[str], left: str | None, right: str | None, what: str
) -> tuple[str, str | None]:
    """Return the names of the left and right camera: the given ones, or the only pair.

    The right one is None if it is given as NO_CAMERA.

    Raises
    ------
    OneCameraError
        If there is only one.
    InputError
        If a given name is unknown, or there is not exactly one pair; the message lists flags to
        choose from.
    """
    for given in (left, right):
        if given not in (None, NO_CAMERA, *names):
            raise InputError(f"{path}: has no {what} {given}; it has {_listing(names)}")
    if right == NO_CAMERA:
        return _only(path, names, left, what), None
    if left is not None and right is not None:
        if left == right:
            raise InputError(f"{path}: --left-topic and --right-topic both name {left}")
        return left, right
    rest = [name for name in names if name not in (left, right)]
    if (left or right) and len(rest) == 1:
        return (left, rest[0]) if left else (rest[0], str(right))
    found = pair(names) if not (left or right) else None
    if found is not None:
        return found
    if len(names) < 2:
        error = OneCameraError if names else InputError
        raise error(
            f"{path}: two cameras are needed, but it holds the events of"
            f" {len(names)}: {_listing(names)}"
        )
    raise InputError(f"{path}: which {what} is which camera? choose {suggestions(names)}")


def _only(path: Path, names: Sequence[str], given: str | None, what: str) -> str:
    if given is None and len(names) != 1:
        choices = " or ".join(f"--left-topic {name}" for name in sorted(names)) or "another file"
        raise InputError(f"{path}: which {what} is the camera? choose {choices}")
    return given or names[0]


def suggestions(names: Sequence[str]) -> str:
    """Return command line flags for the likely pairs of names, ready to be pasted."""
    likely = [(name, other) for name in names for other in counterparts(name) if other in names]
    every = [(a, b) for a in names for b in names if a < b]
    pairs = list(dict.fromkeys(likely or every))
    return " or ".join(f"--left-topic {a} --right-topic {b}" for a, b in pairs[:6])


def _listing(names: Sequence[str]) -> str:
    return ", ".join(sorted(names)) or "none"


def paired_files(path: Path) -> tuple[Path, Path] | None:
    """Return both cameras' files, given one, by swapping left and right in its path, or None.

    The last word counts most: right_turn_left.h5 is the left camera's.
    """
    path = path.absolute()
    for depth in (1, 2, 3):
        if depth >= len(path.parts):
            return None
        root, tail = Path(*path.parts[:-depth]), "/".join(path.parts[-depth:])
        for swapped, is_left in _swapped(tail):
            candidate = root / swapped
            if candidate != path and candidate.is_file():
                return (path, candidate) if is_left else (candidate, path)
    return None


def _swapped(name: str) -> list[tuple[str, bool]]:
    """Return names of the other camera's file, likeliest first, and whether `name` is the left's.

    Words of sides come before numbered cameras, later ones before earlier ones.
    """
    found = []
    for mine, other, is_left in FILE_WORDS:
        for word in re.finditer(mine, name):
            rank = mine not in SIDE_WORDS, -word.start()
            once = name[: word.start()] + word.expand(other) + name[word.end() :]
            found += [(rank, once, is_left), (rank, re.sub(mine, other, name), is_left)]
    return [(swapped, is_left) for _, swapped, is_left in sorted(found, key=lambda one: one[0])]


def files_of(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Return the files with one of the suffixes in a folder and up to three levels below it.

    Suffixes are lower-case; those of files may be upper-case.
    """
    found = [
        file
        for pattern in ("*", "*/*", "*/*/*", "*/*/*/*")
        for file in folder.glob(pattern)
        if file.suffix.lower() in suffixes and file.is_file()
    ]
    return sorted(found)


def camera_files(
    path: Path, candidates: Callable[[], Sequence[Path]], left: str | None, right: str | None
) -> tuple[Path, Path | None]:
    """Return the files of the left and the right camera; see `choose_pair`.

    Parameters
    ----------
    path
        One of the two files, or a folder.
    candidates
        Finds the files of the right kind in the folder; not called where the names suffice.
    left, right
        Names that the user gave, relative to the folder.
    """
    folder = path if path.is_dir() else path.parent
    if path.is_file() and left in (None, path.name) and right in (None, NO_CAMERA):
        both = paired_files(path) if right is None else (path, None)
        if both is None:
            raise OneCameraError(
                f"{path}: holds one camera, and no file of the other was found by its name; give"
                " the folder of both with --left-topic FILE --right-topic FILE"
            )
        return (both[1], both[0]) if left and both[1] == path.absolute() else both
    names = [file.relative_to(folder).as_posix() for file in candidates()]
    first, second = choose_pair(folder, names, left, right, "file")
    return folder / first, None if second is None else folder / second
