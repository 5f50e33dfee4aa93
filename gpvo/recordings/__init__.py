"""Recordings: one reader per format, all giving the same events in the same slabs."""

from gpvo.recordings.base import Events, Recording, StereoEvents
from gpvo.recordings.calibrations import read_calibration
from gpvo.recordings.kalibr import read_kalibr
from gpvo.recordings.opening import open_recording

__all__ = [
    "Events",
    "Recording",
    "StereoEvents",
    "open_recording",
    "read_calibration",
    "read_kalibr",
]
