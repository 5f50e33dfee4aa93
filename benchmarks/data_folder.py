"""Search for a data set's files in the user's folder, with advice if they are missing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gpvo.errors import InputError


def find_file(data: Path, names: Sequence[str], advice: str, elsewhere: Path | None = None) -> Path:
    """Find the first of some names anywhere below the folder.

    Parameters
    ----------
    data
        The user's folder.
    names
        Names or relative paths, the best one first.
    advice
        Where to put which file, for the error message.
    elsewhere
        A second folder to search.

    Raises
    ------
    InputError
        If there is no such folder or none of the names in it.
    """
    if not data.is_dir():
        raise InputError(f"--data {data}: no such folder; {advice}")
    folders = [folder for folder in (data, elsewhere) if folder is not None]
    for name in names:
        for folder in folders:
            if found := sorted(folder.rglob(name)):
                return found[0]
    raise InputError(f"{data}: holds no {' or '.join(names)}; {advice}")


def find_trajectories(folder: Path | None, sequence: str) -> dict[str, Path]:
    """Find competitors' trajectories by name, in folders whose name ends with the sequence's.

    Raises
    ------
    InputError
        If there is no such folder.
    """
    if folder is None:
        return {}
    if not folder.is_dir():
        raise InputError(f"--trajectories {folder}: no such folder; it holds SEQUENCE/NAME.txt")
    files = [file for suffix in ("txt", "tum") for file in folder.glob(f"*{sequence}/*.{suffix}")]
    truths = ("groundtruth", "ground_truth")
    return {file.stem: file for file in sorted(files) if not file.stem.endswith(truths)}
