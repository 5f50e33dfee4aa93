"""Folders that results are written to."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gpvo.errors import InputError


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
        raise InputError(f"{folder}: cannot be written to ({error.strerror})") from error
    return folder
