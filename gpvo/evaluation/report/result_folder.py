"""Folders that results are written to."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks
    fcntl = None  # type: ignore[assignment]

from gpvo.errors import InputError

RESULTS = Path("results")
LATEST = "latest"
"""Link in RESULTS to the folder claimed last."""


def new_folder(name: str) -> Path:
    """Return the folder in RESULTS named by a recording and the time, which is not made yet."""
    return RESULTS / f"{name}_{datetime.now():%Y-%m-%d_%H-%M-%S}"


def _link_latest(folder: Path) -> None:
    """Let `latest` point to a folder in RESULTS."""
    link = RESULTS / f".{LATEST}.{os.getpid()}"
    with suppress(OSError):  # not every file system has links
        link.symlink_to(folder.name)
        link.replace(RESULTS / LATEST)


def make_folder(folder: Path | str, without: Iterable[str] = ()) -> Path:
    """Make a folder and its missing parents.

    Parameters
    ----------
    without
        Files of an earlier result to remove, so that they are not mistaken for new ones.

    Raises
    ------
    InputError
        If the folder cannot be made, or is a file.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in without:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written to ({error.strerror}); give another --output"
        ) from error
    return folder


_claimed: dict[Path, int] = {}
"""Descriptors of the folders that this process writes to, locked until it ends."""


def claim_folder(folder: Path | str, without: Iterable[str] = ()) -> Path:
    """Make a folder as `make_folder` does, for this process alone.

    Raises
    ------
    InputError
        If the folder cannot be written to, or another process writes there.
    """
    folder = make_folder(folder)
    place = folder.resolve()
    if not os.access(place, os.W_OK):
        raise InputError(
            f"{folder}: cannot be written to (Permission denied); give another --output"
        )
    if fcntl is not None and place not in _claimed:
        descriptor = os.open(place, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            raise InputError(
                f"{folder}: another run writes there; wait for it, or give another --output"
            ) from error
        _claimed[place] = descriptor
    if folder.parent == RESULTS and folder.name != LATEST:
        _link_latest(folder)
    return make_folder(folder, without)
