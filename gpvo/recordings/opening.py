"""Find a recording's format from its content and open it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from gpvo.errors import InputError
from gpvo.recordings.base import Recording
from gpvo.recordings.mvsec import MvsecRecording, is_mvsec
from gpvo.recordings.sensor_size import check_sensor_size


class Format(NamedTuple):
    """A kind of recording, how it is recognised and how it is opened."""

    name: str
    recognise: Callable[[Path], bool]
    open: Callable[[Path, Path | str | None], Recording]


FORMATS = (Format("MVSEC HDF5 (davis/left/events, davis/right/events)", is_mvsec, MvsecRecording),)
"""Tried in this order."""


def open_recording(path: Path | str, calibration: Path | str | None = None) -> Recording:
    """Open a stereo event recording of any format that gpvo reads.

    Parameters
    ----------
    path
        The recording; its format is found from what it holds, not from its name.
    calibration
        File of the stereo calibration, for formats that do not hold one: a kalibr camchain.

    Raises
    ------
    InputError
        If there is no such recording, or it or its calibration cannot be used.
    """
    path = Path(path)
    _check_file(path)
    for candidate in FORMATS:
        if candidate.recognise(path):
            recording = candidate.open(path, calibration)
            check_sensor_size(recording, calibration)
            return recording
    known = "; ".join(candidate.name for candidate in FORMATS)
    raise InputError(f"{path}: is not a recording that gpvo reads; it reads {known}")


def _check_file(path: Path) -> None:
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.is_file():
        raise InputError(f"{path}: is not a file; give the file that holds the events")
    try:
        path.open("rb").close()
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror})") from error
