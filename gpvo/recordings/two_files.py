"""Recordings in two files, one for each camera: HDF5 of several kinds, raw, text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.dsec_rectify_map import check_rectify_map
from gpvo.recordings.calibration.find import Calibration, rig_for
from gpvo.recordings.files import hdf5_columns, prophesee_hdf5
from gpvo.recordings.files.hdf5_columns import ColumnStream
from gpvo.recordings.files.prophesee_raw import RawStream, is_raw
from gpvo.recordings.files.text import TextStream, is_text
from gpvo.recordings.hdf5 import has_dataset
from gpvo.recordings.pairing import camera_files, files_of
from gpvo.recordings.stereo import StreamRecording
from gpvo.recordings.streams import EventStream


@dataclass(frozen=True)
class TwoFiles:
    """A kind of recording with one file for each camera."""

    name: str
    suffixes: tuple[str, ...]
    is_kind: Callable[[Path], bool]
    stream: Callable[[Path], EventStream]

    def recognise(self, path: Path) -> bool:
        """Return whether a file is of this kind, or a folder contains such files."""
        return self.is_kind(path) if path.is_file() else bool(self._files(path))

    def open(
        self, path: Path, calibration: Calibration, left: str | None, right: str | None
    ) -> Recording:
        """Open the files of both cameras."""
        folder = path if path.is_dir() else path.parent
        files = camera_files(path, self._files(folder), left, right)
        rig = rig_for(path, calibration, self.name)
        if self.is_kind is COLUMNS.is_kind:
            for file, camera in zip(files, (rig.left, rig.right), strict=True):
                check_rectify_map(file.with_name("rectify_map.h5"), camera, rig.K_rect)
        return StreamRecording(path, self.name, rig, self.stream(files[0]), self.stream(files[1]))

    def _files(self, folder: Path) -> list[Path]:
        return [file for file in files_of(folder, self.suffixes) if self.is_kind(file)]


HDF5 = (".h5", ".hdf5")

COLUMNS = TwoFiles(
    "DSEC, TUM-VIE or VECtor HDF5",
    HDF5,
    lambda path: has_dataset(path, hdf5_columns.DSEC.x),
    lambda path: ColumnStream(path, hdf5_columns.DSEC),
)
EVENT_UTILS = TwoFiles(
    "event_utils HDF5",
    HDF5,
    lambda path: has_dataset(path, hdf5_columns.EVENT_UTILS.x),
    lambda path: ColumnStream(path, hdf5_columns.EVENT_UTILS),
)
PROPHESEE_HDF5 = TwoFiles(
    "Prophesee HDF5",
    HDF5,
    lambda path: has_dataset(path, prophesee_hdf5.EVENTS),
    prophesee_hdf5.TableStream,
)
RAW = TwoFiles("Prophesee raw", (".raw",), is_raw, RawStream)
TEXT = TwoFiles("text (t x y polarity)", (".txt", ".csv"), is_text, TextStream)

KINDS = (COLUMNS, EVENT_UTILS, PROPHESEE_HDF5, RAW, TEXT)
