"""Find a recording's format from its content and open it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from gpvo.errors import InputError
from gpvo.recordings import two_files
from gpvo.recordings.bags.mcap import McapFile
from gpvo.recordings.bags.rosbag1 import RosBag1
from gpvo.recordings.bags.rosbag2 import ZSTD, is_rosbag2, open_rosbag2
from gpvo.recordings.bags.topics import open_log
from gpvo.recordings.base import SIDES, Recording
from gpvo.recordings.calibration.find import Calibration, rig_for
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.checks.sensor_size import check_sensor_size
from gpvo.recordings.checks.time_unit import check_time_unit
from gpvo.recordings.files.aedat4 import is_aedat4, open_aedat4
from gpvo.recordings.files.hdf5_columns import M3ED, ColumnStream
from gpvo.recordings.files.mvsec import TABLES, MvsecRecording, is_mvsec
from gpvo.recordings.files.text_names import REMEDY
from gpvo.recordings.hdf5 import has_dataset
from gpvo.recordings.pairing import NO_CAMERA, choose_pair
from gpvo.recordings.stereo import StreamRecording


class Format(NamedTuple):
    """A kind of recording, how it is recognised and how it is opened.

    `open` takes the path, the calibration, and the user's names of the left and right camera.
    """

    name: str
    recognise: Callable[[Path], bool]
    open: Callable[[Path, Calibration, str | None, str | None], Recording]


def _open_mvsec(
    path: Path, calibration: Calibration, left: str | None, right: str | None
) -> Recording:
    if left is None and right is None:
        return MvsecRecording(path, calibration)
    names = [name for name in TABLES.values() if has_dataset(path, name)]
    first, second = choose_pair(path, names, left, right, "dataset")
    if second is None:
        alone = {side: name for side, name in TABLES.items() if name == first}
        return MvsecRecording(path, calibration, alone)
    return MvsecRecording(path, calibration, {"left": first, "right": second})


def _open_m3ed(
    path: Path, calibration: Calibration, left: str | None, right: str | None
) -> Recording:
    names = [side for side in SIDES if has_dataset(path, M3ED[side].x)]
    if (left, right) == SIDES[::-1]:
        raise InputError(f"{path}: names left and right itself; leave --left-topic right out")
    sides = [side for side in choose_pair(path, names, left, right, "camera") if side is not None]
    rig = rig_for(path, calibration or path, "M3ED")
    streams = (ColumnStream(path, M3ED[side]) for side in sides)
    return StreamRecording(path, "M3ED HDF5", rig, *streams, sides=sides)


FORMATS = (
    Format("MVSEC HDF5 (davis/left/events, davis/right/events)", is_mvsec, _open_mvsec),
    Format(
        "M3ED HDF5",
        lambda path: any(has_dataset(path, layout.x) for layout in M3ED.values()),
        _open_m3ed,
    ),
    Format("ROS 1 bag", RosBag1.recognise, lambda path, *how: open_log(RosBag1(path), *how)),
    Format("MCAP", McapFile.recognise, lambda path, *how: open_log(McapFile(path), *how)),
    Format("ROS 2 bag", is_rosbag2, lambda path, *how: open_log(open_rosbag2(path), *how)),
    Format("AEDAT4", is_aedat4, open_aedat4),
    *(Format(kind.name, kind.recognise, kind.open) for kind in two_files.KINDS),
)
"""Tried in this order."""

ARCHIVES = {
    "zip": b"PK\3\4",
    "gzip": b"\x1f\x8b",
    "bzip2": b"BZh",
    "xz": b"\xfd7zXZ\0",
    "zstd": ZSTD,
    "7z": b"7z\xbc\xaf\x27\x1c",
}
"""First bytes of packed files, in which data sets come."""

TAR = slice(257, 262)
"""Where tar says what it is."""

SUFFIXES = (".hdf5", ".h5", ".bag", ".mcap")
"""Suffixes of recordings in one file."""


def open_recording(
    path: Path | str,
    calibration: Calibration = None,
    left_topic: str | None = None,
    right_topic: str | None = None,
) -> Recording:
    """Open a stereo event recording of any format that gpvo reads.

    Parameters
    ----------
    path
        The recording, or a folder with one. The format is recognised from the content, not from
        the name. If each camera has a file of its own, give either file or their folder.
    calibration
        File of the stereo calibration (see `read_calibration`), or a rig. Not needed if the
        recording contains its calibration, or if one of its name or only one lies beside it.
    left_topic, right_topic
        Topics (files in a folder, streams in AEDAT4) of both cameras, if their names do not show
        which is left and which is right.

    Raises
    ------
    InputError
        If there is no such recording, or it or its calibration cannot be used.
    """
    if right_topic == NO_CAMERA:
        raise InputError(f"{path}: two cameras are needed; --right-topic names the second")
    return open_cameras(Path(path), calibration, left_topic, right_topic)


def open_cameras(
    path: Path, calibration: Calibration, left_topic: str | None, right_topic: str | None
) -> Recording:
    """Open a recording as `open_recording`, or one camera of it, with NO_CAMERA as right one."""
    _check_readable(path)
    for candidate in FORMATS:
        if candidate.recognise(path):
            recording = candidate.open(path, calibration, left_topic, right_topic)
            check_time_unit(recording)
            if not isinstance(calibration, StereoRig):
                check_sensor_size(recording, calibration)
            return recording
    if path.is_dir() and (inside := _recordings_in(path)):
        if len(inside) > 1:
            raise InputError(
                f"{path}: holds several recordings; name one: {' '.join(map(str, inside))}"
            )
        return open_cameras(inside[0], calibration, left_topic, right_topic)
    if path.is_dir():
        two_files.tell_unreadable(path)
    raise InputError(_unknown(path))


def _recordings_in(folder: Path) -> list[Path]:
    """Return the single-file recordings in a folder, without ground truths."""
    files = [
        file
        for file in sorted(folder.iterdir())
        if file.suffix.lower() in SUFFIXES and file.is_file() and not file.stem.endswith("_gt")
    ]
    return [file for file in files if any(one.recognise(file) for one in FORMATS)]


def _unknown(path: Path) -> str:
    known = "; ".join(candidate.name for candidate in FORMATS)
    if path.is_file() and path.suffix.lower() in two_files.TEXT.suffixes:
        return f"{path}: its columns are not t, x, y and polarity; if they are, {REMEDY}"
    kind = "file" if path.is_file() else "folder: it is not a file, and none in it"
    return f"{path}: is not a recording that gpvo reads ({kind}); it reads {known}"


def _check_readable(path: Path) -> None:
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: is a pipe or a device; write the recording to a file")
    try:
        if path.is_dir():
            next(path.iterdir(), None)
        else:
            _check_unpacked(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror})") from error


def _check_unpacked(path: Path) -> None:
    """Raise InputError for an archive; text in one that is not compressed looks like events."""
    with path.open("rb") as file:
        head = file.read(TAR.stop)
    kinds = (kind for kind, magic in ARCHIVES.items() if head.startswith(magic))
    kind = "tar" if head[TAR] == b"ustar" else next(kinds, None)
    if kind is not None:
        raise InputError(f"{path}: is packed by {kind}; unpack it first")
