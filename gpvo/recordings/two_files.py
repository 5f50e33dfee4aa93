"""Recordings in two files, one for each camera: HDF5 of several kinds, raw, text.

A text file may hold both cameras.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gpvo.errors import InputError
from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.dsec_rectify_map import check_rectify_map
from gpvo.recordings.calibration.find import Calibration, rig_for
from gpvo.recordings.files import hdf5_columns, prophesee_hdf5
from gpvo.recordings.files.hdf5_columns import ColumnStream
from gpvo.recordings.files.prophesee_raw import RawStream, is_raw
from gpvo.recordings.files.text import TextStream, cameras_in, is_text
from gpvo.recordings.hdf5 import has_dataset
from gpvo.recordings.pairing import camera_files, choose_pair, files_of
from gpvo.recordings.stereo import StreamRecording
from gpvo.recordings.streams import EventStream

log = logging.getLogger("gpvo.recordings")


@dataclass(frozen=True)
class TwoFiles:
    """A kind of recording with one file for each camera.

    `stream` takes the file and the camera's (width, height).
    """

    name: str
    suffixes: tuple[str, ...]
    is_kind: Callable[[Path], bool]
    stream: Callable[[Path, tuple[int, int]], EventStream]

    def recognise(self, path: Path) -> bool:
        """Return whether a file is of this kind, or a folder contains such files."""
        return self.is_kind(path) if path.is_file() else bool(self.files(path, []))

    def open(
        self, path: Path, calibration: Calibration, left: str | None, right: str | None
    ) -> Recording:
        """Open the files of both cameras."""
        both = self._both(path, left, right)
        rig = rig_for(path, calibration, self.name)
        streams = []
        for file, camera in zip(both, (rig.left, rig.right), strict=True):
            if file is not None:
                streams.append(self.stream(file, camera.resolution))
                if self.is_kind is COLUMNS.is_kind:
                    check_rectify_map(file.with_name("rectify_map.h5"), camera, rig.K_rect)
        return StreamRecording(path, self.name, rig, *streams)

    def _both(self, path: Path, left: str | None, right: str | None) -> tuple[Path, Path | None]:
        """Return the cameras' files; what else cannot be read is told only if it may be one."""
        folder = path if path.is_dir() else path.parent
        problems: list[InputError] = []
        try:
            both = camera_files(path, lambda: self.files(folder, problems), left, right)
        except InputError:
            tell(problems)
            raise
        for problem in problems:
            log.warning("left out: %s", problem)
        return both

    def files(self, folder: Path, problems: list[InputError]) -> list[Path]:
        """Return the files of this kind in a folder, and add why others cannot be read."""
        found = []
        for file in files_of(folder, self.suffixes):
            try:
                if self.is_kind(file):
                    found.append(file)
            except InputError as problem:
                problems.append(problem)
        return found


HDF5 = (".h5", ".hdf5")

COLUMNS = TwoFiles(
    "DSEC, TUM-VIE or VECtor HDF5",
    HDF5,
    lambda path: has_dataset(path, hdf5_columns.DSEC.x),
    lambda path, _: ColumnStream(path, hdf5_columns.DSEC),
)
EVENT_UTILS = TwoFiles(
    "event_utils HDF5",
    HDF5,
    lambda path: has_dataset(path, hdf5_columns.EVENT_UTILS.x),
    lambda path, _: ColumnStream(path, hdf5_columns.EVENT_UTILS),
)
PROPHESEE_HDF5 = TwoFiles(
    "Prophesee HDF5",
    HDF5,
    lambda path: has_dataset(path, prophesee_hdf5.EVENTS),
    lambda path, _: prophesee_hdf5.TableStream(path),
)
RAW = TwoFiles("Prophesee raw", (".raw",), is_raw, lambda path, _: RawStream(path))


class TextFiles(TwoFiles):
    """Text, of which one file may hold both cameras."""

    def open(
        self, path: Path, calibration: Calibration, left: str | None, right: str | None
    ) -> Recording:
        """Open the cameras in one file, or the files of both."""
        names = cameras_in(path) if path.is_file() else ()
        if not names:
            return super().open(path, calibration, left, right)
        chosen = choose_pair(path, names, left, right, "camera")
        rig = rig_for(path, calibration, self.name)
        cameras = zip(chosen, (rig.left, rig.right), strict=True)
        streams = [TextStream(path, camera.resolution, name) for name, camera in cameras if name]
        return StreamRecording(path, self.name, rig, *streams)


TEXT = TextFiles("text (t, x, y, polarity)", (".txt", ".csv"), is_text, TextStream)

KINDS = (COLUMNS, EVENT_UTILS, PROPHESEE_HDF5, RAW, TEXT)


def tell_unreadable(folder: Path) -> None:
    """Raise InputError if a file in a folder of no recordings may be one, but cannot be read."""
    problems: list[InputError] = []
    for kind in KINDS:
        kind.files(folder, problems)
    tell(problems)


def tell(problems: Sequence[InputError]) -> None:
    """Raise the first error, if there is one."""
    for problem in problems:
        raise problem
