"""Folders that results are written to."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gpvo.errors import InputError


def make_folder(folder: Path | str, without: Iterable[str] = ()) -> Path:
    """Make a folder and those above it where they are missing.

    Parameters
    ----------
    without
        Files of an earlier result, to be removed so that they cannot be taken for the new one's.

    Raises
    ------
    InputError
        If that cannot be done, or it is a file.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in without:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written to ({error.strerror})") from error
    return folder
