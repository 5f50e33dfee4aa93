"""Convert recordings: every event of both cameras, to the microsecond, and the calibration."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal, get_args

from gpvo.errors import InputError
from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.writing.aedat4 import Aedat4Writer
from gpvo.recordings.writing.bags import McapWriter, RosBag1Writer
from gpvo.recordings.writing.hdf5 import DsecWriter, MvsecWriter
from gpvo.recordings.writing.writer import RecordingWriter, Size, stamped, write_camchain

Kind = Literal["mvsec", "dsec", "rosbag1", "mcap", "aedat4"]

WRITERS: dict[str, type[RecordingWriter]] = {
    "mvsec": MvsecWriter,
    "dsec": DsecWriter,
    "rosbag1": RosBag1Writer,
    "mcap": McapWriter,
    "aedat4": Aedat4Writer,
}

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
) -> tuple[int, int]:
    """Write a recording in another format.

    The calibration is written beside it as a kalibr camchain, where `open_recording` finds it;
    a recording opened with UNKNOWN_RIG is written without one.

    Parameters
    ----------
    output
        File, or folder for DSEC; must not exist.
    kind
        Key of WRITERS; if None, found from the ending of `output`.
    advance
        Called with the seconds written so far.

    Returns
    -------
    (left, right)
        Numbers of events that were written.

    Raises
    ------
    InputError
        If the kind is unknown or cannot be found, or `output` exists or cannot be written.
    """
    output = Path(output)
    kind = kind or kind_of(output)
    if kind not in WRITERS:
        raise InputError(f"--to {kind}: is unknown; choose one of {', '.join(get_args(Kind))}")
    calibration = camchain_path(output, kind)
    calibrated = recording.rig is not UNKNOWN_RIG
    for path in (output, calibration) if calibrated else (output,):
        if path.exists():
            raise InputError(f"{path}: exists; name another output or remove it")
    part = output.with_name(output.name + ".part")
    try:
        counts = _write(recording, part, WRITERS[kind], advance)
        part.rename(output)
        if calibrated:
            write_camchain(calibration, recording.rig)
    except OSError as error:
        raise InputError(f"{output}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(OSError):
            _remove(part)
    return counts


def kind_of(output: Path) -> Kind:
    """Return the format for the ending of a file's name."""
    if output.suffix not in ENDINGS:
        raise InputError(
            f"{output}: which format? its ending says nothing; give --to {'|'.join(get_args(Kind))}"
        )
    return ENDINGS[output.suffix]


def camchain_path(output: Path, kind: str) -> Path:
    """Return the path of a converted recording's calibration."""
    return output / "camchain.yaml" if kind == "dsec" else output.with_suffix(".camchain.yaml")


def _write(
    recording: Recording,
    path: Path,
    writer: type[RecordingWriter],
    advance: Callable[[float], object],
) -> tuple[int, int]:
    _remove(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    left_count = right_count = 0
    with writer(path, sensor_sizes(recording), recording.start_ns) as opened:
        for batch in recording.event_batches():
            left, right = (stamped(side, recording.start_ns) for side in (batch.left, batch.right))
            opened.append(left, right)
            left_count, right_count = left_count + len(left), right_count + len(right)
            advance(batch.stop)
    return left_count, right_count


def sensor_sizes(recording: Recording) -> tuple[Size, Size]:
    """Return (width, height) of both cameras; zeros if neither calibration nor file has them."""
    if recording.rig is not UNKNOWN_RIG:
        return recording.rig.left.resolution, recording.rig.right.resolution
    streams = getattr(recording, "streams", {})
    left, right = (streams[side].resolution if streams else None for side in ("left", "right"))
    return left or (0, 0), right or (0, 0)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
