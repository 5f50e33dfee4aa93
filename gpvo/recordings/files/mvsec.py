"""Read MVSEC's HDF5: one table of x, y, t, polarity for each camera of a pair of DAVIS346."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np

from gpvo.recordings.base import SIDES, Recording, StereoEvents
from gpvo.recordings.calibration.find import Calibration, rig_for
from gpvo.recordings.checks import columns
from gpvo.recordings.event_batches import BATCH_LENGTH, stereo_batches
from gpvo.recordings.files.mvsec_table import EventTable
from gpvo.recordings.hdf5 import holds, open_hdf5
from gpvo.recordings.reading_faults import ReadingFaults

TABLES = {side: f"davis/{side}/events" for side in SIDES}
"""Names of the cameras' tables."""


def is_mvsec(path: Path) -> bool:
    """Return whether an HDF5 file has MVSEC's group of cameras; raise InputError if damaged."""
    if not h5py.is_hdf5(path):
        return False
    with open_hdf5(path) as file:
        return holds(file, "davis")


class MvsecRecording(Recording):
    """Recording `*_data.hdf5` of MVSEC (Zhu et al., RA-L 2018), calibrated by a separate file.

    Parameters
    ----------
    path
        File with davis/left/events and davis/right/events, (N, 4) float64: x, y, seconds, and
        polarity in {-1, 1} or {0, 1}.
    calibration
        File of the stereo calibration, usually a kalibr camchain; None for the only one beside it.
    tables
        Names of both cameras' tables, or of one.
    batch_length
        Seconds.

    Raises
    ------
    OneCameraError
        If the file has no events of a camera.
    InputError
        If the file or the calibration cannot be used. Faults of single events are found while
        batches are read, as no dataset is ever read as a whole.
    """

    format_name = "MVSEC HDF5"

    def __init__(
        self,
        path: Path,
        calibration: Calibration,
        tables: Mapping[str, str] = TABLES,
        batch_length: float = BATCH_LENGTH,
    ) -> None:
        self.path = path
        self.rig = rig_for(path, calibration, "MVSEC's HDF5")
        self.batch_length = batch_length
        self._tables, self.sides = tables, tuple(tables)
        self.faults = ReadingFaults({side: f"{path}: {name}" for side, name in tables.items()})
        with open_hdf5(path) as file:
            spans = [self._table(file, side).span() for side in self.sides]
        columns.check_common_time(spans[0], spans[-1], path, " and ".join(tables.values()))
        self._start = min(first for first, _ in spans)
        self.start_ns = round(self._start * 1e9)
        self.duration = max(last for _, last in spans) - self._start

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = self.within(start, stop)
        self.faults.clear()
        with open_hdf5(self.path) as file:
            left, right = (
                self._table(file, side).blocks(self._start, start, self.faults[side])
                if side in self.sides
                else iter(())
                for side in SIDES
            )
            for batch in stereo_batches(left, right, start, stop, self.batch_length):
                self.faults.say_new(batch.stop)
                yield batch

    def _table(self, file: h5py.File, side: str) -> EventTable:
        return EventTable.open(file, self._tables[side], self.rig.camera(side).resolution)
