"""Convert recordings: every event of both cameras, to the microsecond, and the calibration."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from gpvo.errors import InputError, OutputError, require_choice
from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.find import OWN
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.writing.aedat4 import Aedat4Writer
from gpvo.recordings.writing.bags import McapWriter, RosBag1Writer
from gpvo.recordings.writing.hdf5 import DsecWriter, MvsecWriter
from gpvo.recordings.writing.raw import RawWriter
from gpvo.recordings.writing.text import CsvWriter, TextWriter
from gpvo.recordings.writing.writer import (
    RecordingWriter,
    Size,
    Sizes,
    camchain_text,
    stamped,
    write_camchain,
)

Kind = Literal["mvsec", "dsec", "rosbag1", "mcap", "aedat4", "raw", "text", "csv"]

WRITERS: dict[str, type[RecordingWriter]] = {
    "mvsec": MvsecWriter,
    "dsec": DsecWriter,
    "rosbag1": RosBag1Writer,
    "mcap": McapWriter,
    "aedat4": Aedat4Writer,
    "raw": RawWriter,
    "text": TextWriter,
    "csv": CsvWriter,
}
FOLDERS = ("dsec", "raw", "text", "csv")
"""Kinds with a folder, in which each camera has a file."""

ENDINGS: dict[str, Kind] = {
    ".hdf5": "mvsec",
    ".h5": "mvsec",
    ".bag": "rosbag1",
    ".mcap": "mcap",
    ".aedat4": "aedat4",
    "": "dsec",
}


def convert(
    recording: Recording,
    output: Path | str,
    kind: str | None = None,
    advance: Callable[[float], object] = lambda _: None,
) -> tuple[int, ...]:
    """Write a recording in another format.

    The calibration is written beside it as a kalibr camchain, where `open_recording` finds it;
    a recording opened with UNKNOWN_RIG is written without one. One camera alone is written as the
    left one.

    Parameters
    ----------
    output
        File, or folder for FOLDERS; must not exist.
    kind
        Key of WRITERS; if None, found from the ending of `output`.
    advance
        Called with the seconds written so far.

    Returns
    -------
    counts
        Number of events that were written of each camera.

    Raises
    ------
    InputError
        If the kind is unknown or cannot be found, or `output` exists or has no folder.
    OutputError
        If it cannot be written, as the disk is full.
    """
    output = Path(output)
    kind = kind or kind_of(output)
    require_choice("--to", kind, Kind)
    calibration = camchain_path(output, kind)
    calibrated = recording.rig is not UNKNOWN_RIG
    if calibrated:
        require_free(calibration, recording.rig)
    _make_place(output)
    part = output.with_name(output.name + ".part")
    try:
        counts = _write(recording, part, WRITERS[kind], advance)
        part.rename(output)
        if calibrated:
            write_camchain(calibration, recording.rig)
    except OSError as error:
        problem = f"{output}: cannot be written ({error.strerror or error})"
        raise OutputError(f"{problem}; nothing was saved") from error
    finally:
        with suppress(OSError):
            _remove(part)
    return counts


def _make_place(output: Path) -> None:
    """Make the folder that an output is to be in; InputError if that cannot be, or it exists."""
    if output.exists():
        raise InputError(f"{output}: exists; name another output or remove it")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror or error})") from error


def require_free(calibration: Path, rig: StereoRig) -> None:
    """Raise InputError if the camchain of a rig would replace another file."""
    same = calibration.is_file() and calibration.read_bytes() == camchain_text(rig).encode()
    if calibration.exists() and not same:
        raise InputError(
            f"{calibration}: exists, with another calibration; name another output or remove it"
        )


def kind_of(output: Path, asked: bool = True) -> Kind:
    """Return the format for the ending of a file's name; `asked` if there is an option --to."""
    if output.suffix not in ENDINGS:
        kinds = " or ".join(f"--to {kind}" for kind in get_args(Kind))
        endings = ", ".join(ending for ending in ENDINGS if ending)
        option = f", or give {kinds}; {', '.join(FOLDERS)} need a folder"
        raise InputError(
            f"{output}: which format? let its name end with one of {endings}"
            f"{option if asked else ', or none for a folder in the format of DSEC'}"
        )
    return ENDINGS[output.suffix]


def camchain_path(output: Path, kind: str) -> Path:
    """Return the path of a converted recording's calibration."""
    return output / "camchain.yaml" if kind in FOLDERS else output.with_suffix(OWN)


def _write(
    recording: Recording,
    path: Path,
    writer: type[RecordingWriter],
    advance: Callable[[float], object],
) -> tuple[int, ...]:
    _remove(path)
    counts = np.zeros(len(recording.sides), np.int64)
    with writer(path, sensor_sizes(recording), recording.start_ns) as opened:
        for batch in recording.event_batches():
            events = [getattr(batch, side) for side in recording.sides]
            opened.append(*(stamped(side, recording.start_ns) for side in events))
            counts += [len(side) for side in events]
            advance(batch.stop)
    return tuple(counts.tolist())


def sensor_sizes(recording: Recording) -> Sizes:
    """Return (width, height) of each camera.

    Where neither calibration nor file has them, the smallest that hold all events.
    """
    if recording.rig is not UNKNOWN_RIG:
        return tuple(getattr(recording.rig, side).resolution for side in recording.sides)
    streams = getattr(recording, "streams", {})
    stated = [streams[side].resolution if streams else None for side in recording.sides]
    return tuple(size for size in stated if size) if all(stated) else _reach(recording)


def _reach(recording: Recording) -> Sizes:
    """Return the smallest size of each camera that holds all its events."""
    reach: list[Size] = [(0, 0)] * len(recording.sides)
    for batch in recording.event_batches():
        for number, side in enumerate(recording.sides):
            events, (width, height) = getattr(batch, side), reach[number]
            if len(events):
                far = int(events.x.max()) + 1, int(events.y.max()) + 1
                reach[number] = max(width, far[0]), max(height, far[1])
    return tuple(reach)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
